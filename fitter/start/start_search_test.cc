#include "fitter/start/start_search.h"

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <numbers>

#include "fitter/solve/fit.h"
#include "fitter/testing/problem.h"

namespace armtrue {
namespace {

using nlohmann::json;
using testing::Problem;
using testing::Random;

json with_effect(const json& effect) {
  json model = testing::geometry_model();
  model["effects"].push_back(effect);
  return model;
}

double rms_of(const Problem& p, const json& model) {
  FitOptions options;
  options.cross_validate = false;
  return Fit::run(p.robot, p.columns, ModelSpecification::from_json(model), options)
      ->train_error()
      .rms;
}

// A fit that has found a balancer's ratio and phase.
std::unique_ptr<Fit> with_balancer() {
  Random random(302);
  const json told{{"effect", "gravity_balancer"}, {"ratio", 0.4}, {"phase", 0.7}};
  const Problem p(testing::industrial_arm(), with_effect(told), {150, false, 1, 1e-5, 2e-5, {}},
                  random,
                  [&](const Parameter& q) { return q.effect == "gravity_balancer" ? 2e-3 : 0.0; });
  return Fit::run(p.robot, p.columns,
                  ModelSpecification::from_json(with_effect({{"effect", "gravity_balancer"}})), {});
}

// A fit with the balancer's true geometry given is no better than one that has to search for it.
TEST(StartSearch, FindsABalancerOfAnyRatioAndPhase) {
  Random random(301);
  for (int trial = 0; trial < 12; ++trial) {
    const json told{{"effect", "gravity_balancer"},
                    {"ratio", testing::uniform(random, 0.15, 0.9)},
                    {"phase", testing::uniform(random, -std::numbers::pi, std::numbers::pi)}};
    const Problem p(testing::industrial_arm(), with_effect(told), {150, false, 1, 1e-5, 2e-5, {}},
                    random, [&](const Parameter& q) {
                      if (q.effect == "base_frame" || q.effect == "tool_offset") return 0.0;
                      if (q.effect == "gravity_balancer")
                        return testing::uniform(random, 1e-3, 3e-3);
                      return testing::normal(random, q.unit == "m" ? 2e-4 : 5e-4);
                    });
    EXPECT_LT(rms_of(p, with_effect({{"effect", "gravity_balancer"}})),
              1.001 * rms_of(p, with_effect(told)))
        << told.dump();
  }
}

// Linear unknowns are solved within the search: it returns the point where the descent ends, except
// for the chain's curvature.
TEST(StartSearch, ResultIsCloseToTheEndOfTheDescent) {
  const auto fit = with_balancer();
  Design& design = fit->design();
  const std::vector<double> end = design.unknown_values();
  std::vector<double> away = end;
  away[away.size() - 1] += 0.4;
  away[away.size() - 2] *= 0.8;
  design.set_unknowns(away.data());
  const std::vector<double> found = search_starts(design, fit->smoothness_sigma());
  EXPECT_EQ(design.unknown_values(), away) << "the design stays as it was";
  EXPECT_NEAR(found[found.size() - 2], end[end.size() - 2], 2e-3);
  EXPECT_NEAR(found[found.size() - 1], end[end.size() - 1], 2e-3);
}

// The only good start may be the smallest value of every nonlinear parameter.
TEST(StartSearch, TriesEveryCombinationOfStarts) {
  const auto fit = with_balancer();
  Model model = fit->model();
  const std::vector<double> end = fit->design().unknown_values();
  for (std::size_t j = 0; j < 2; ++j) {
    NonlinearParameter& n = model.nonlinear[model.nonlinear.size() - 1 - j];
    const double best = end[end.size() - 1 - j];
    n.starts = {best + 0.2, best};
  }
  Design design(fit->state(), fit->measurements(), model, fit->kinematics());
  design.set_free(fit->design().free_parameters());
  for (NonlinearParameter& n : model.nonlinear) n.starts = {n.starts.back()};
  Design told_design(fit->state(), fit->measurements(), model, fit->kinematics());
  told_design.set_free(fit->design().free_parameters());
  const std::vector<double> found = search_starts(design, fit->smoothness_sigma());
  const std::vector<double> best = search_starts(told_design, fit->smoothness_sigma());
  EXPECT_NEAR(found[found.size() - 2], best[best.size() - 2], 2e-3);
  EXPECT_NEAR(found[found.size() - 1], best[best.size() - 1], 2e-3);
}

}  // namespace
}  // namespace armtrue
