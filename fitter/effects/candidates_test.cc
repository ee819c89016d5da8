// Candidates that effects propose for a recorded state, and the terms of an entry without options.
#include <gtest/gtest.h>

#include <numbers>
#include <set>

#include "fitter/effects/effect.h"
#include "fitter/testing/problem.h"

namespace armtrue {
namespace {

using nlohmann::json;
using testing::Problem;
using testing::Random;

// The state of an industrial arm, with or without column temp_arm, and duty3.
struct Recorded {
  explicit Recorded(bool thermometer, bool duty = false) {
    Random random(5);
    problem.emplace(testing::industrial_arm(), testing::geometry_model(),
                    testing::ProblemOptions{40}, random, testing::nothing);
    State::Columns columns = problem->columns;
    if (!thermometer) columns.erase("temp_arm");
    if (duty) columns["duty3"] = std::vector<double>(columns.at("q1").size(), 0.5);
    state.emplace(problem->robot, columns, Eigen::Vector3d::Zero());
  }
  EffectContext context() const { return EffectContext{*state}; }
  std::vector<EffectRequest> tried(const std::string& effect) const {
    return find_effect(effect).tried(context());
  }

  std::optional<Problem> problem;
  std::optional<State> state;
};

std::vector<std::string> names(const EffectTerms& terms) {
  std::vector<std::string> result;
  for (const Parameter& p : terms.parameters) result.push_back(p.name);
  return result;
}

// The different options of an effect's candidates on one joint.
std::set<std::string> options_on(const std::vector<EffectRequest>& tried, int joint) {
  std::set<std::string> found;
  for (const EffectRequest& request : tried) {
    if (request.joints == std::vector<int>{joint}) found.insert(request.options.dump());
  }
  return found;
}

TEST(SelfHeating, CandidatesUseTheDutyIfRecordedElseAThermometer) {
  std::set<std::string> bare;
  for (const char* tau : {"500", "700", "1000", "1400", "2000", "2800", "4000"})
    bare.insert(std::string(R"({"tau":)") + tau + ".0}");
  EXPECT_EQ(options_on(Recorded(true, true).tried("self_heating"), 3), bare);
  EXPECT_EQ(options_on(Recorded(false).tried("self_heating"), 2), bare);
  const auto warm = options_on(Recorded(true).tried("self_heating"), 2);
  EXPECT_EQ(warm.size(), 7u);
  EXPECT_TRUE(warm.contains(R"({"sensor":"arm","tau":500.0})"));
}

TEST(CouplingHarmonics, EntryWithoutOptions_HasOneAndTwoWavesATurn) {
  const Recorded arm(true);
  const EffectTerms terms = build_effect(arm.context(), {"coupling_harmonics", {5, 4}});
  EXPECT_EQ(names(terms), (std::vector<std::string>{
                              "coupling_harmonics[5,4].sin1", "coupling_harmonics[5,4].cos1",
                              "coupling_harmonics[5,4].sin2", "coupling_harmonics[5,4].cos2"}));
}

TEST(GravityBalancer, CandidatePhasesCoverTheWholeTurn) {
  std::set<double> phases;
  for (const EffectRequest& request : Recorded(true).tried("gravity_balancer"))
    phases.insert(request.options.at("phase").get<double>());
  ASSERT_EQ(phases.size(), 12u);
  EXPECT_NEAR(*phases.begin(), -std::numbers::pi, 1e-12);
  EXPECT_NEAR(*phases.rbegin(), 5.0 / 6.0 * std::numbers::pi, 1e-12);
}

TEST(TrackerScale, EntryWithoutOptions_IsProportionalToDistance) {
  const Recorded arm(true);
  const EffectTerms scale = build_effect(arm.context(), {"tracker_scale", {}});
  const EffectTerms length =
      build_effect(arm.context(), {"tracker_scale", {}, {{"constant", true}}});
  EXPECT_EQ(scale.parameters.at(0).unit, "m/m");
  EXPECT_EQ(length.parameters.at(0).unit, "m");
}

}  // namespace
}  // namespace armtrue
