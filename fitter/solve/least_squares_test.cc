#include "fitter/solve/least_squares.h"

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "fitter/solve/fit.h"
#include "fitter/testing/problem.h"

namespace armtrue {
namespace {

using nlohmann::json;
using testing::Problem;
using testing::Random;

// An arm with a balancer whose ratio and phase are searched for, and its design at the solution.
struct Balanced {
  Balanced() {
    Random random(302);
    const auto model = [](const json& balancer) {
      json with = testing::geometry_model();
      with["effects"].push_back(balancer);
      return with;
    };
    const json told{{"effect", "gravity_balancer"}, {"ratio", 0.4}, {"phase", 0.7}};
    const Problem p(
        testing::industrial_arm(), model(told), {150, false, 1, 1e-5, 2e-5, {}}, random,
        [&](const Parameter& q) { return q.effect == "gravity_balancer" ? 2e-3 : 0.0; });
    fit = Fit::run(p.robot, p.columns,
                   ModelSpecification::from_json(model({{"effect", "gravity_balancer"}})), {});
    solution = fit->design().unknown_values();
  }

  std::unique_ptr<Fit> fit;
  std::vector<double> solution;
};

// Steps from so far away overshoot: without damping the cost would rise.
TEST(LeastSquares, FarStart_ConvergesToTheSameCost) {
  Balanced b;
  Design& design = b.fit->design();
  const SolveSummary at_solution = solve(design, b.fit->smoothness_sigma());
  EXPECT_TRUE(at_solution.converged);
  for (const double turned : {-1.2, -0.6, 0.6, 1.2}) {
    std::vector<double> away = b.solution;
    away[away.size() - 1] += turned;
    away[away.size() - 2] *= 0.5;
    design.set_unknowns(away.data());
    const SolveSummary back = solve(design, b.fit->smoothness_sigma());
    EXPECT_TRUE(back.converged) << back.message;
    EXPECT_NEAR(back.cost, at_solution.cost, 1e-6 * at_solution.cost) << turned;
  }
}

TEST(LeastSquares, IntermediateAccuracy_CostIsWithinOnePercent) {
  Balanced b;
  Design& design = b.fit->design();
  std::vector<double> away = b.solution;
  for (std::size_t u = 0; u + 2 < away.size(); ++u) away[u] = 0.0;
  design.set_unknowns(away.data());
  const SolveSummary near = solve(design, b.fit->smoothness_sigma(), Accuracy::kOnTheWay);
  design.set_unknowns(away.data());
  const SolveSummary full = solve(design, b.fit->smoothness_sigma());
  EXPECT_LE(near.iterations, full.iterations);
  EXPECT_NEAR(near.cost, full.cost, 1e-2 * full.cost);
}

// A nonlinear parameter whose best value is outside its range stays at the limit, and all others
// are optimal for it there.
TEST(LeastSquares, ParameterAtItsLimit_OthersAreOptimal) {
  Balanced b;
  Model model = b.fit->model();
  const double edge = b.solution.back() - 0.05;
  model.nonlinear.back().upper = edge;
  Design design(b.fit->state(), b.fit->measurements(), model, b.fit->kinematics());
  design.set_free(b.fit->design().free_parameters());
  std::vector<double> start = b.solution;
  start.back() = edge - 0.3;
  design.set_unknowns(start.data());
  const SolveSummary bounded = solve(design, b.fit->smoothness_sigma());
  EXPECT_TRUE(bounded.converged) << bounded.message;
  EXPECT_EQ(design.unknown_values().back(), edge);
  // The gradient of all others is zero: no change of them lowers the cost.
  const std::vector<double> found = design.unknown_values();
  const Eigen::VectorXd spreads = b.fit->covariance().diagonal().cwiseSqrt();
  for (std::size_t u = 0; u + 1 < found.size(); ++u) {
    std::vector<double> moved = found;
    const double spread = spreads[static_cast<Eigen::Index>(u)];
    for (const double step : {-0.3 * spread, 0.3 * spread}) {
      moved[u] = found[u] + step;
      design.set_unknowns(moved.data());
      double cost = squared_residuals(design);
      for (const PenaltyRow& row : penalty_rows(design, b.fit->smoothness_sigma()))
        cost += row.residual(moved) * row.residual(moved);
      EXPECT_GT(cost, bounded.cost) << u;
    }
  }
}

}  // namespace
}  // namespace armtrue
