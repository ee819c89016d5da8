#include "fitter/inference/table_evidence.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "fitter/inference/identifiability.h"
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

// An arm whose third joint has a table with second differences of standard deviation `sigma`.
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

TEST(TableEvidence, WithoutTables_IsZero) {
  Random random(1);
  const Problem p(testing::industrial_arm(), testing::geometry_model(), {40}, random,
                  [](const Parameter&) { return 0.0; });
  Design design = p.make_design();
  const TableEvidence evidence = table_evidence(design, accumulate(design).information, 1e-4);
  EXPECT_EQ(evidence.penalty, 0.0);
  EXPECT_EQ(evidence.occam, 0.0);
}

TEST(TableEvidence, OccamFactorGrowsAsMeasurementsNarrowTheTable) {
  const TableArm arm(2, 3e-5);
  Design design = solved(arm.problem, 3e-5);
  const NormalEquations data = accumulate(design);
  // Without measurements, the posterior of a table is as wide as its prior.
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

TEST(TableEvidence, LikeliestSmoothnessIsNearTheTrueOne) {
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

}  // namespace
}  // namespace armtrue
