#include "fitter/diagnose/line_advice.h"

#include <gtest/gtest.h>

#include <algorithm>

#include "fitter/testing/problem.h"

namespace armtrue {
namespace {

using nlohmann::json;
using testing::Problem;
using testing::Random;

// Measured poses of an arm whose gear ratios are 120, or for which that of joint 5 is not stated.
Problem measured(bool with_ratio = true) {
  Random random(5);
  json robot = testing::industrial_arm();
  if (!with_ratio) robot["kinematics"]["joints"][4].erase("gear_ratio");
  return Problem(robot, testing::geometry_model(), {40}, random, testing::nothing);
}

std::vector<std::string> advice_on(const json& options, double grid = 0.0, bool with_ratio = true) {
  JointSpectrum spectrum;
  spectrum.joint = 5;
  spectrum.resolution = 0.8;
  spectrum.grid = grid;
  spectrum.cycles = {0.5, 300.0};
  const Problem p = measured(with_ratio);
  return line_advice({"gear_mesh", {5}, options}, {spectrum}, EffectContext{*p.state});
}

// An oval tracker circle, which has orders but belongs to no joint, crashed every diagnosis that
// recommended it.
TEST(LineAdvice, AnyCandidateOfTheCatalogue_OnlyLinesOfJointsAreExplained) {
  const Problem p = measured();
  const EffectContext context{*p.state};
  for (const Effect* effect : effect_catalogue()) {
    for (const EffectRequest& request : effect->tried(context)) {
      const bool has_lines = !effect->lines(context, request).empty();
      EXPECT_TRUE(line_advice(request, {}, context).empty()) << effect->id();
      EXPECT_EQ(has_lines, effect->id() == "gear_mesh") << effect->id();
    }
  }
  const auto oval = find_effect("tracker_angles").tried(context);
  EXPECT_TRUE(std::ranges::any_of(
      oval, [](const EffectRequest& r) { return r.options.contains("orders"); }));
}

TEST(LineAdvice, LineAtAMotorOrder_NamesTheOrder) {
  EXPECT_EQ(
      advice_on({{"cycles", {360.0}}}),
      (std::vector<std::string>{
          "360 cycles a turn on joint 5: look for a gear or bearing with this number of cycles "
          "per turn",
          "360 cycles a turn is 3 times the motor's 120 turns per joint turn"}));
  EXPECT_EQ(advice_on({{"cycles", {40.0}}}).back(),
            "40 cycles a turn is 1/3 times the motor's 120 turns per joint turn");
  EXPECT_EQ(
      advice_on({{"cycles", {119.7}}}).back(),
      "119.7 cycles a turn is 1 times the motor's turns per joint turn if gear_ratio is 119.7 "
      "instead of the 120 in robot.yaml");
}

TEST(LineAdvice, LineAtNoMotorOrder_NamesOtherCauses) {
  const std::string words = advice_on({{"cycles", {40.5}}}).back();
  EXPECT_NE(words.find("0.338 times the motor's 120 turns"), std::string::npos) << words;
  EXPECT_NE(words.find("the 0.8 cycles that the joint's travel resolves"), std::string::npos);
  // 1080 is nine times the motor's turns: more than any shaft's order.
  EXPECT_NE(advice_on({{"cycles", {1080.0}}}).back().find("no multiple"), std::string::npos);
}

TEST(LineAdvice, WithoutGearRatio_NamesTheCountOnly) {
  EXPECT_EQ(advice_on({{"cycles", {13.0}}}, 0.0, false).size(), 1u);
}

TEST(LineAdvice, OrderOfTheMotor_NeedsNoExplanation) {
  EXPECT_TRUE(advice_on({{"orders", {1.0}}}).empty());
}

TEST(LineAdvice, PositionsOnAGrid_NamesTheAliases) {
  const std::string words = advice_on({{"cycles", {13.0}}}, 0.1745329251994330).front();
  EXPECT_EQ(words.find("all values of q5 are on a grid of 10 deg, on which 23 cycles a turn"), 0u)
      << words;
  // The motor turns 120 times: on a grid of 50 deg (7.2 positions a turn) that is like 2.4 turns.
  EXPECT_EQ(advice_on({{"orders", {1.0}}}, 0.8726646259971648),
            (std::vector<std::string>{
                "all values of q5 are on a grid of 50 deg, on which 2.4 cycles a turn and 4.8 "
                "cycles a turn look the same as 120 cycles a turn (aliasing): measure poses "
                "between the grid values"}));
}

}  // namespace
}  // namespace armtrue
