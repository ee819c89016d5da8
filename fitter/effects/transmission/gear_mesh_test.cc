#include <gtest/gtest.h>

#include <algorithm>
#include <numbers>

#include "fitter/effects/effect.h"
#include "fitter/testing/arms.h"
#include "fitter/testing/problem.h"

namespace armtrue {
namespace {

using nlohmann::json;
using testing::Problem;
using testing::Random;

// An arm whose first joint slides; `turn`: further entries of its row.
Problem with_slide(const json& turn) {
  Random random(5);
  json robot = testing::random_chain(random, 4, {0});
  robot["kinematics"]["joints"][0].erase("gear_ratio");
  if (!turn.empty()) robot["kinematics"]["joints"][0].update(turn);
  return Problem(robot, testing::geometry_model(), {40}, random, testing::nothing);
}

std::vector<std::string> names(const Problem& p, const EffectRequest& request) {
  std::vector<std::string> result;
  for (const Parameter& q : build_effect({*p.state, 1}, request).parameters)
    result.push_back(q.name);
  return result;
}

std::string refusal(const Problem& p, const EffectRequest& request) {
  try {
    build_effect({*p.state, 1}, request);
  } catch (const ModelError& error) {
    return error.what();
  }
  return "";
}

TEST(GearMesh, SlidingJoint_HasWavesOfItsLeadInMetres) {
  const Problem p = with_slide({{"lead", 0.02}});
  const EffectTerms terms = build_effect({*p.state, 1}, {"gear_mesh", {1}, {{"orders", {1, 2}}}});
  ASSERT_EQ(terms.parameters.size(), 4u);
  EXPECT_EQ(terms.parameters[0].name, "gear_mesh[1].sin1");
  EXPECT_EQ(terms.parameters[0].unit, "m");
  EXPECT_EQ(terms.parameters[0].bound, 5e-4);
  EXPECT_EQ(terms.parameters[0].terms.front().basis.to_string(),
            Expression::parse("sin(2*pi*q1/0.02)").to_string());
  EXPECT_EQ(terms.parameters[3].terms.front().basis.to_string(),
            Expression::parse("cos(2*pi*q1/0.01)").to_string());
}

// A motor that turns opposite to its joint makes the same waves.
TEST(GearMesh, NegativeGearRatio_HasTheSameOrders) {
  const auto orders_with = [](double ratio) {
    Random random(5);
    json robot = testing::industrial_arm();
    robot["kinematics"]["joints"][0]["gear_ratio"] = ratio;
    const Problem p(robot, testing::geometry_model(), {40}, random, testing::nothing);
    const EffectContext context{*p.state, 1};
    std::vector<std::string> terms;
    for (const EffectRequest& request : find_effect("gear_mesh").tried(context)) {
      if (request.joints != std::vector{1}) continue;
      for (const Parameter& q : build_effect(context, request).parameters)
        terms.push_back(q.name + " " + q.terms.front().basis.to_string());
    }
    return terms;
  };
  EXPECT_EQ(orders_with(120.0).size(), 8u);
  EXPECT_EQ(orders_with(-120.0), orders_with(120.0));
}

TEST(GearMesh, OlderFile_GearRatioOfASlideInRadPerMetre_IsItsLead) {
  const Problem p = with_slide({{"gear_ratio", 200.0 * std::numbers::pi}});
  EXPECT_NEAR(p.robot.joints[0].lead, 0.01, 1e-12);
}

TEST(GearMesh, SlidingJoint_WavesAreNamedByTheirLength) {
  const Problem p = with_slide({});
  EXPECT_EQ(names(p, {"gear_mesh", {1}, {{"wavelengths", {0.02, 0.0201}}}}),
            (std::vector<std::string>{"gear_mesh[1].sin20mm", "gear_mesh[1].cos20mm",
                                      "gear_mesh[1].sin20.1mm", "gear_mesh[1].cos20.1mm"}));
}

TEST(GearMesh, FittedLength_ChangesByHalfAWaveOverTheTravelAtMost) {
  const Problem p = with_slide({{"lead", 0.02}});
  const EffectTerms terms = build_effect({*p.state, 1}, {"gear_mesh", {1}, {{"find", true}}});
  ASSERT_EQ(terms.nonlinear.size(), 1u);
  const NonlinearParameter& length = terms.nonlinear.front();
  EXPECT_EQ(length.unit, "m");
  const std::vector<double>& q = p.state->column("q1");
  const double travel = *std::ranges::max_element(q) - *std::ranges::min_element(q);
  EXPECT_NEAR(travel / length.lower - travel / length.value, 0.5, 1e-9);
  EXPECT_NEAR(travel / length.value - travel / length.upper, 0.5, 1e-9);
}

TEST(GearMesh, OptionOfTheOtherJointType_IsRefusedWithTheRightOne) {
  const Problem p = with_slide({});
  EXPECT_EQ(refusal(p, {"gear_mesh", {1}, {{"cycles", {50}}}}),
            "effect gear_mesh: found cycles for joint 1, which slides, expected wavelengths in "
            "metres");
  EXPECT_EQ(refusal(p, {"gear_mesh", {2}, {{"lead", 0.02}}}),
            "effect gear_mesh: found lead for joint 2, which turns, expected ratio, the motor's "
            "turns per joint turn");
  EXPECT_EQ(refusal(p, {"gear_mesh", {1}}),
            "effect gear_mesh: joint 1 has no lead in robot.yaml; give it there, or lead or "
            "wavelengths in model.yaml");
  EXPECT_NE(refusal(p, {"gear_harmonics", {1}}).find("a revolute joint 1"), std::string::npos);
}

TEST(GearMesh, SlidingJoint_HasTwoCandidatesIfItsLeadIsKnown) {
  const auto of_slide = [](const Problem& p) {
    const auto all = find_effect("gear_mesh").tried({*p.state, 1});
    return std::ranges::count_if(all,
                                 [](const EffectRequest& r) { return r.joints == std::vector{1}; });
  };
  EXPECT_EQ(of_slide(with_slide({{"lead", 0.02}})), 2);
  EXPECT_EQ(of_slide(with_slide({})), 0);
}

}  // namespace
}  // namespace armtrue
