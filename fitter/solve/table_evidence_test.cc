#include "fitter/solve/table_evidence.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "fitter/solve/identifiability.h"
#include "fitter/solve/least_squares.h"
#include "fitter/testing/problem.h"

namespace armtrue {
namespace {

using nlohmann::json;
using testing::Problem;
using testing::Random;

constexpr double kNoise = 1e-5;

json table_model(double spacing) {
  json model = testing::geometry_model();
  model["effects"].push_back(
      {{"effect", "transmission_pwl"}, {"joints", {3}}, {"spacing", spacing}});
  return model;
}

// An arm whose third joint has a table of which the second differences have one standard deviation.
struct TableArm {
  Random random;
  double slope = 0.0, value = 0.0;
  Problem problem;

  TableArm(std::uint64_t seed, double sigma)
      : random(seed),
        problem(testing::industrial_arm(), table_model(0.2), {300, false, 1, kNoise, 2e-5, {}},
                random, [&](const Parameter& p) {
                  if (p.effect != "transmission_pwl") return 0.0;
                  slope += testing::normal(random, sigma);
                  return value += slope;
                }) {}
};

Design solved(const Problem& problem, double smoothness) {
  Design design = problem.make_design();
  design.set_free(identify(design).kept);
  solve(design, smoothness);
  return design;
}

TEST(TableEvidence, IsNothingWithoutTables) {
  Random random(1);
  const Problem p(testing::industrial_arm(), testing::geometry_model(), {40}, random,
                  [](const Parameter&) { return 0.0; });
  Design design = p.make_design();
  const TableEvidence evidence = table_evidence(design, accumulate(design).information, 1e-4);
  EXPECT_EQ(evidence.penalty, 0.0);
  EXPECT_EQ(evidence.occam, 0.0);
}

TEST(TableEvidence, OccamFactorIsWhatTheMeasurementsNarrowTheTableBy) {
  const TableArm arm(2, 3e-5);
  Design design = solved(arm.problem, 3e-5);
  const NormalEquations data = accumulate(design);
  // A table that nothing measured is as wide after as before.
  const Eigen::MatrixXd nothing = Eigen::MatrixXd::Zero(design.unknowns(), design.unknowns());
  EXPECT_NEAR(table_evidence(design, nothing, 3e-5).occam, 0.0, 1e-6);
  // A hundred times the information narrows every well measured direction by ten: log 100 each.
  const double once = table_evidence(design, data.information, 3e-5).occam;
  const double more = table_evidence(design, 100.0 * data.information, 3e-5).occam;
  int nodes = 0;
  for (int u = 0; u < design.unknowns(); ++u) nodes += design.is_table_unknown(u);
  EXPECT_GT(once, 0.0);
  EXPECT_GT(more - once, 0.5 * nodes * std::log(100.0));
  EXPECT_LT(more - once, nodes * std::log(100.0));
}

TEST(TableEvidence, FindsTheSmoothnessThatTheTableHas) {
  const std::vector<double> tried{1e-6, 3e-6, 1e-5, 3e-5, 1e-4, 3e-4, 1e-3};
  for (const double sigma : {1e-5, 1e-4}) {
    for (std::uint64_t seed = 3; seed < 8; ++seed) {
      const TableArm arm(seed, sigma);
      Design design = solved(arm.problem, 3e-5);
      const double found = likeliest_smoothness(design, accumulate(design), tried).sigma;
      EXPECT_LE(std::abs(std::log10(found / sigma)), 0.6) << sigma << " seed " << seed;
    }
  }
}

// −2 log of the marginal likelihood at the best of some smoothnesses, each solved for.
double least_evidence(Design& design, const std::vector<double>& tried) {
  double least = std::numeric_limits<double>::infinity();
  for (const double smoothness : tried) {
    solve(design, smoothness);
    const NormalEquations data = accumulate(design);
    const TableEvidence tables = table_evidence(design, data.information, smoothness);
    least =
        std::min(least, static_cast<double>(data.equations) * std::log(data.cost + tables.penalty) +
                            tables.occam);
  }
  return least;
}

TEST(TableEvidence, OfBlocksBesideATableIsThatOfRealRefits) {
  const std::vector<double> tried{1e-6, 1e-5, 1e-4, 1e-3};
  for (const double amplitude : {0.0, 5e-5}) {
    Random random(9);
    json model = table_model(0.3);
    model["effects"].push_back({{"effect", "gear_harmonics"}, {"joints", {3}}, {"orders", {4}}});
    const Problem with(
        testing::industrial_arm(), model, {300, false, 1, kNoise, 2e-5, {}}, random,
        [&](const Parameter& p) { return p.effect == "gear_harmonics" ? amplitude : 0.0; });
    Design whole = with.make_design();
    std::vector<int> all = identify(whole).kept, rest, block;
    for (const int p : all) {
      (with.model.parameters[static_cast<std::size_t>(p)].effect == "gear_harmonics" ? block : rest)
          .push_back(p);
    }
    ASSERT_EQ(block.size(), 2u);
    whole.set_free(rest);
    const double without = least_evidence(whole, tried);
    solve(whole, 1e-6);
    const EvaluatedRows evaluated = evaluate_rows(whole);
    whole.set_free(all);
    Eigen::MatrixXd columns = Eigen::MatrixXd::Zero(900, 2);
    Design::Row row;
    for (std::size_t i = 0; i < 300; ++i) {
      whole.evaluate(i, true, row);
      for (std::size_t u = 0; u < row.unknowns.size(); ++u) {
        for (std::size_t b = 0; b < 2; ++b) {
          if (row.unknowns[u] != whole.unknown_of(block[b])) continue;
          columns.block<3, 1>(3 * static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(b)) =
              row.jacobian.block<3, 1>(0, static_cast<Eigen::Index>(u));
        }
      }
    }
    whole.set_free(rest);
    // Twice the same block, to see that blocks do not see each other.
    Eigen::MatrixXd twice(900, 4);
    twice << columns, columns;
    const std::vector<double> changes =
        bic_changes_beside_tables(whole, evaluated, twice, {2, 2}, tried);
    whole.set_free(all);
    const double expected = least_evidence(whole, tried) + 2.0 * std::log(900.0) - without;
    ASSERT_EQ(changes.size(), 2u);
    EXPECT_EQ(changes[0], changes[1]);
    EXPECT_NEAR(changes[0], expected, 1.0 + 0.02 * std::abs(expected)) << amplitude;
    if (amplitude > 0.0) {
      EXPECT_LT(changes[0], -25.0);
    } else {
      EXPECT_GT(changes[0], 0.0);
    }
  }
}

}  // namespace
}  // namespace armtrue
