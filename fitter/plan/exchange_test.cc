#include "fitter/plan/exchange.h"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <memory>
#include <numeric>
#include <set>

namespace armtrue {
namespace {

constexpr int kEquationsPerRow = 3;

std::vector<bool> all_of(const Criterion& criterion) {
  return std::vector<bool>(criterion.count(), true);
}

// A random linear problem: possible measurements of three rows each, and a start of other rows.
struct LinearProblem {
  Eigen::MatrixXd jacobian, start;
  Eigen::VectorXd difference, gradient;
  double squares = 0.0;

  LinearProblem(int measurements, int unknowns, std::uint64_t seed) {
    std::mt19937_64 generator(seed);
    const auto random = [&] { return 2.0 * uniform(generator) - 1.0; };
    jacobian = Eigen::MatrixXd::NullaryExpr(kEquationsPerRow * measurements, unknowns, random);
    difference = Eigen::VectorXd::NullaryExpr(kEquationsPerRow * measurements, random);
    const Eigen::MatrixXd taken = Eigen::MatrixXd::NullaryExpr(2 * unknowns, unknowns, random);
    const Eigen::VectorXd taken_difference = Eigen::VectorXd::NullaryExpr(2 * unknowns, random);
    start = taken.transpose() * taken;
    gradient = taken.transpose() * taken_difference;
    squares = taken_difference.squaredNorm();
  }

  Eigen::MatrixXd information(const std::vector<std::size_t>& rows) const {
    Eigen::MatrixXd sum = start;
    for (const std::size_t i : rows) {
      const auto block =
          jacobian.middleRows(static_cast<Eigen::Index>(i) * kEquationsPerRow, kEquationsPerRow);
      sum += block.transpose() * block;
    }
    return sum;
  }

  double log_determinant(const std::vector<std::size_t>& rows) const {
    return std::log(information(rows).determinant());
  }

  // Least squares over the start and the rows, written out.
  double left(const std::vector<std::size_t>& rows) const {
    Eigen::VectorXd right = gradient;
    double sum = squares;
    for (const std::size_t i : rows) {
      const Eigen::Index at = static_cast<Eigen::Index>(i) * kEquationsPerRow;
      right += jacobian.middleRows(at, kEquationsPerRow).transpose() *
               difference.segment(at, kEquationsPerRow);
      sum += difference.segment(at, kEquationsPerRow).squaredNorm();
    }
    return sum - right.dot(information(rows).ldlt().solve(right));
  }

  MeasurementChoice choice() const {
    return MeasurementChoice(jacobian, kEquationsPerRow, start, difference, gradient, squares);
  }
};

class ChoiceOfMeasurements : public ::testing::TestWithParam<int> {};
INSTANTIATE_TEST_SUITE_P(Seeds, ChoiceOfMeasurements, ::testing::Range(0, 8));

TEST_P(ChoiceOfMeasurements, AddAndRemoveMatchANewSolution) {
  const LinearProblem problem(12, 5, static_cast<std::uint64_t>(GetParam()));
  MeasurementChoice choice = problem.choice();
  std::mt19937_64 generator(static_cast<std::uint64_t>(GetParam()) + 100);
  std::set<std::size_t> taken;
  for (int step = 0; step < 30; ++step) {
    const std::size_t i = generator() % 12;
    if (taken.contains(i)) {
      choice.remove(i);
      taken.erase(i);
    } else {
      const double promised = choice.log_determinant() + choice.log_determinant_gain(i);
      const double promised_left = choice.left() + choice.left_gain(i);
      choice.add(i);
      taken.insert(i);
      EXPECT_NEAR(choice.log_determinant(), promised, 1e-9);
      EXPECT_NEAR(choice.left(), promised_left, 1e-9);
    }
    const std::vector<std::size_t> rows(taken.begin(), taken.end());
    EXPECT_NEAR(choice.log_determinant(),
                problem.log_determinant(rows) - problem.log_determinant({}), 1e-8);
    EXPECT_NEAR(choice.left(), problem.left(rows), 1e-8);
  }
}

TEST(MeasurementChoice, RemovingTheOnlyInformation_KeepsPrecision) {
  LinearProblem problem(4, 6, 3);
  problem.start = 1e-6 * Eigen::MatrixXd::Identity(6, 6);
  problem.gradient.setZero();
  problem.squares = 0.0;
  MeasurementChoice choice = problem.choice();
  choice.add(0);
  choice.add(1);
  for (const std::size_t i : {2, 3}) {
    // Six equations for six unknowns: without one of the two measurements, three directions are
    // practically undetermined.
    choice.remove(1);
    choice.add(i);
    choice.remove(i);
    choice.add(1);
    EXPECT_TRUE(std::isfinite(choice.log_determinant_gain(i)));
    EXPECT_NEAR(choice.log_determinant(),
                problem.log_determinant({0, 1}) - problem.log_determinant({}), 1e-6);
    EXPECT_NEAR(choice.left(), problem.left({0, 1}), 1e-6);
  }
}

// All choices of `count` out of `size`.
template <typename Visit>
void for_all_choices(std::size_t size, std::size_t count, const Visit& visit) {
  std::vector<bool> in(size, false);
  std::fill(in.begin(), in.begin() + static_cast<std::ptrdiff_t>(count), true);
  do {
    std::vector<std::size_t> rows;
    for (std::size_t i = 0; i < size; ++i) {
      if (in[i]) rows.push_back(i);
    }
    visit(rows);
  } while (std::prev_permutation(in.begin(), in.end()));
}

TEST_P(ChoiceOfMeasurements, ExchangeComesNearTheBestOfAllChoices) {
  const LinearProblem problem(11, 4, static_cast<std::uint64_t>(GetParam()) + 40);
  Criterion criterion(MeasurementChoice(problem.jacobian, kEquationsPerRow, problem.start));
  const std::vector<std::size_t> chosen = choose_best(criterion, 4, all_of(criterion));
  EXPECT_EQ(std::set<std::size_t>(chosen.begin(), chosen.end()).size(), 4U);
  double best = -1e300, sum = 0.0;
  int choices = 0;
  for_all_choices(11, 4, [&](const std::vector<std::size_t>& rows) {
    const double value = problem.log_determinant(rows);
    best = std::max(best, value);
    sum += value;
    ++choices;
  });
  const double mean = sum / choices;
  const double found = problem.log_determinant(chosen);
  EXPECT_LE(found, best + 1e-9);
  EXPECT_GT(found - mean, 0.9 * (best - mean));
}

TEST_P(ChoiceOfMeasurements, TOptimalChoice_LeastOfPairsBeatsRandomChoices) {
  const LinearProblem first(40, 4, static_cast<std::uint64_t>(GetParam()) + 60);
  const LinearProblem second(40, 4, static_cast<std::uint64_t>(GetParam()) + 80);
  const auto least_of = [&](const std::vector<std::size_t>& rows) {
    return std::min(first.left(rows), second.left(rows));
  };
  std::vector<MeasurementChoice> pairs;
  pairs.push_back(first.choice());
  pairs.push_back(second.choice());
  Criterion criterion(std::move(pairs));
  const double chosen = least_of(choose_best(criterion, 6, all_of(criterion)));
  std::mt19937_64 generator(5);
  for (int draw = 0; draw < 200; ++draw) {
    EXPECT_GE(chosen, least_of(choose_random(40, 6, generator)));
  }
}

TEST(ChooseBest, CountAboveAvailable_TakesAll) {
  const LinearProblem problem(3, 2, 1);
  Criterion criterion(MeasurementChoice(problem.jacobian, kEquationsPerRow, problem.start));
  std::vector<std::size_t> chosen = choose_best(criterion, 10, all_of(criterion));
  std::sort(chosen.begin(), chosen.end());
  EXPECT_EQ(chosen, (std::vector<std::size_t>{0, 1, 2}));
}

TEST_P(ChoiceOfMeasurements, ChooseBestTakesOnlyAllowedMeasurements) {
  const LinearProblem problem(30, 4, static_cast<std::uint64_t>(GetParam()) + 90);
  Criterion criterion(MeasurementChoice(problem.jacobian, kEquationsPerRow, problem.start));
  std::vector<bool> even(30, false);
  for (std::size_t i = 0; i < 30; i += 2) even[i] = true;
  for (const std::size_t i : choose_best(criterion, 8, even)) EXPECT_TRUE(even[i]) << i;
}

TEST(ChooseRandom, NumbersAreDistinctAndEquallyFrequent) {
  std::mt19937_64 generator(3);
  std::vector<int> hits(10, 0);
  for (int draw = 0; draw < 2000; ++draw) {
    const std::vector<std::size_t> rows = choose_random(10, 3, generator);
    EXPECT_EQ(std::set<std::size_t>(rows.begin(), rows.end()).size(), 3U);
    for (const std::size_t i : rows) ++hits[i];
  }
  // 600 each, five standard deviations of the binomial distribution.
  for (const int hit : hits) EXPECT_NEAR(hit, 600, 103);
}

}  // namespace
}  // namespace armtrue
