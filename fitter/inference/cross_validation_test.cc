#include "fitter/inference/cross_validation.h"

#include <gtest/gtest.h>

#include <cmath>
#include <map>
#include <set>

#include "fitter/testing/problem.h"

namespace armtrue {
namespace {

using testing::Problem;
using testing::Random;

Problem some_problem(std::size_t rows, bool repeats) {
  Random random(81);
  Problem p(testing::industrial_arm(), testing::geometry_model(), {rows}, random,
            [](const Parameter&) { return 0.0; });
  if (repeats) {
    for (std::size_t i = 0; i < rows; ++i) p.measurements.repeat.push_back(static_cast<int>(i / 3));
    p.measurements.poses = find_poses(*p.state, p.measurements.target, p.measurements.repeat);
  }
  return p;
}

class EveryFolding : public ::testing::TestWithParam<Folding> {};
INSTANTIATE_TEST_SUITE_P(Foldings, EveryFolding,
                         ::testing::Values(Folding::kRandom, Folding::kTime, Folding::kRegion));

TEST_P(EveryFolding, EveryRowIsInOneFoldAndRepeatsStayTogether) {
  const Problem p = some_problem(60, true);
  const Design design = p.make_design();
  const std::vector<int> folds = make_folds(design, GetParam(), 5, 3);
  ASSERT_EQ(folds.size(), 60u);
  std::set<int> used(folds.begin(), folds.end());
  EXPECT_EQ(used, (std::set<int>{0, 1, 2, 3, 4}));
  for (std::size_t i = 0; i < 60; ++i) EXPECT_EQ(folds[i], folds[i / 3 * 3]);
}

TEST_P(EveryFolding, IsTheSameForTheSameSeed) {
  const Problem p = some_problem(50, false);
  const Design design = p.make_design();
  EXPECT_EQ(make_folds(design, GetParam(), 4, 9), make_folds(design, GetParam(), 4, 9));
}

TEST(Folding, RandomFoldsChangeWithTheSeedAndAreEven) {
  const Problem p = some_problem(100, false);
  const Design design = p.make_design();
  const std::vector<int> folds = make_folds(design, Folding::kRandom, 5, 1);
  EXPECT_NE(folds, make_folds(design, Folding::kRandom, 5, 2));
  std::map<int, int> count;
  for (const int f : folds) ++count[f];
  for (const auto& [fold, rows] : count) EXPECT_EQ(rows, 20) << fold;
}

TEST(Folding, TimeFoldsAreBlocksOfTimeWhateverTheRowOrder) {
  Problem p = some_problem(40, false);
  std::vector<double>& time = p.columns["time"];
  std::reverse(time.begin(), time.end());
  p.state = std::make_unique<State>(p.robot, p.columns, Eigen::Vector3d::Zero());
  const Design design = p.make_design();
  const std::vector<int> folds = make_folds(design, Folding::kTime, 4, 0);
  for (std::size_t i = 0; i < 40; ++i) EXPECT_EQ(folds[i], static_cast<int>((39 - i) / 10));
}

TEST(Folding, RegionsAreCompact) {
  const Problem p = some_problem(200, false);
  const Design design = p.make_design();
  const std::vector<int> folds = make_folds(design, Folding::kRegion, 5, 0);
  std::map<int, std::vector<Eigen::Vector3d>> members;
  for (std::size_t i = 0; i < folds.size(); ++i) {
    members[folds[i]].push_back(p.measurements.position.col(static_cast<Eigen::Index>(i)));
  }
  Eigen::Vector3d centre_of_all = p.measurements.position.rowwise().mean();
  double within = 0.0, all = 0.0;
  for (const auto& [fold, points] : members) {
    Eigen::Vector3d centre = Eigen::Vector3d::Zero();
    for (const Eigen::Vector3d& point : points)
      centre += point / static_cast<double>(points.size());
    for (const Eigen::Vector3d& point : points) {
      within += (point - centre).squaredNorm();
      all += (point - centre_of_all).squaredNorm();
    }
  }
  EXPECT_LT(within, 0.5 * all);
}

TEST(HeldOut, UnknownThatNoRowDetermines_AllDistancesAreFinite) {
  Random random(82);
  // No row reaches q1 > 100, so that no row determines this term.
  nlohmann::json model = testing::geometry_model();
  model["effects"].push_back({{"effect", "custom"},
                              {"name", "never"},
                              {"coordinate", "motor1"},
                              {"expression", "max(0, q1 - 100)"}});
  Problem p(testing::industrial_arm(), model, {60}, random, testing::nothing);
  Design design = p.make_design();
  const std::vector<std::vector<double>> distances = held_out_distances(
      design, evaluate_rows(design), {make_folds(design, Folding::kRandom, 5, 3)}, 5, 1e-3);
  for (const double distance : distances.at(0)) EXPECT_TRUE(std::isfinite(distance));
}

}  // namespace
}  // namespace armtrue
