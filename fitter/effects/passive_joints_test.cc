// A joint without a motor: the rules for it in robot.yaml, and how effects treat it.
#include <gtest/gtest.h>

#include <algorithm>
#include <nlohmann/json.hpp>

#include "fitter/effects/effect.h"
#include "fitter/plan/cell.h"
#include "fitter/testing/arms.h"

namespace armtrue {
namespace {

using nlohmann::json;

// Joints 2, 3 and 4 turn about parallel axes; bars keep link 4 level, so that joint 4 turns by the
// opposite of joints 2 and 3. `parallelogram`: axis 3's motor turns link 3 against the base.
json palletiser(bool parallelogram) {
  json robot = testing::industrial_arm();
  json& joints = robot["kinematics"]["joints"];
  joints.erase(5);
  joints[3]["alpha"] = 0.0;
  joints[3]["passive"] = true;
  joints[3].erase("gear_ratio");
  joints[3].erase("limits");
  const auto row = [](int joint, int driving, double ratio) {
    return json{{"joint", joint}, {"driving", driving}, {"ratio", ratio}};
  };
  if (parallelogram) {
    robot["coupling"] = {row(3, 2, -1.0), row(4, 3, -1.0)};
    robot["linkage"] = {{"type", "parallelogram"}, {"joints", {2, 3}}, {"angle", 1.5}};
  } else {
    robot["coupling"] = {row(4, 2, -1.0), row(4, 3, -1.0)};
  }
  return robot;
}

// An arm and the state of a few poses, in which the passive joint has no column.
struct Measured {
  explicit Measured(const json& content) : robot(Robot::from_json(content)) {
    testing::Random random(3);
    columns = testing::random_joints(robot, 8, random);
    testing::add_recorded_state(robot, random, columns);
    columns.erase("q4");
    state.emplace(robot, columns, Eigen::Vector3d::Zero());
  }
  EffectContext context() const { return EffectContext{*state}; }

  Robot robot;
  State::Columns columns;
  std::optional<State> state;
};

std::string refusal(const json& content) {
  try {
    Robot::from_json(content);
  } catch (const ModelError& error) {
    return error.what();
  }
  return "";
}

TEST(PassiveJoint, ContradictingRobotFile_IsRefusedWithTheReason) {
  json undriven = palletiser(false);
  undriven["coupling"] = json::array();
  EXPECT_EQ(refusal(undriven),
            "robot: joint 4 is passive, but no coupling drives it, expected at least one");
  json reported = palletiser(false);
  reported["coupling"][0]["kind"] = "controller";
  EXPECT_EQ(
      refusal(reported),
      "robot: joint 4 is passive, but its coupling is of kind controller, expected mechanical");
  json drives = palletiser(false);
  drives["coupling"][0] = {{"joint", 5}, {"driving", 4}, {"ratio", 1.0}};
  EXPECT_EQ(refusal(drives),
            "robot: joint 4 is passive, but coupling has it drive joint 5, expected a joint with a "
            "motor");
  json geared = palletiser(false);
  geared["kinematics"]["joints"][3]["gear_ratio"] = 90.0;
  EXPECT_EQ(refusal(geared),
            "robot: joint 4 is passive, but has a gear_ratio, expected none: it has no motor");
}

TEST(PassiveJoint, StateHasZeroMotorAngleAndALevelLink) {
  const Measured arm(palletiser(false));
  const std::vector<double>& level = arm.state->column("th4");
  for (std::size_t i = 0; i < arm.state->rows(); ++i) {
    EXPECT_EQ(arm.state->column("q4")[i], 0.0);
    EXPECT_DOUBLE_EQ(level[i], -arm.columns.at("q2")[i] - arm.columns.at("q3")[i]);
  }
}

TEST(PassiveJoint, EffectsOfADrive_OmitIt) {
  const Measured arm(palletiser(false));
  for (const Effect* effect : effect_catalogue()) {
    const bool driving_alone = effect->drive_rule() == DriveRule::kDriving;
    for (const EffectRequest& request : effect->tried(arm.context())) {
      for (std::size_t i = 0; i < request.joints.size(); ++i) {
        if (effect->drive_rule() == DriveRule::kEach || (driving_alone && i % 2 == 1)) {
          EXPECT_NE(request.joints[i], 4) << effect->id();
        }
      }
    }
  }
  const auto count = [&](const char* id) {
    return find_effect(id).joints_of_bare_entry(arm.context()).size();
  };
  EXPECT_EQ(count("joint_offset"), 5U);
  EXPECT_EQ(count("joint_scale"), 4U);
  const std::vector<int> motors{1, 2, 3, 5};
  const std::vector<EffectRequest> tried = find_effect("command_readback").tried(arm.context());
  EXPECT_EQ(tried.back().joints, motors);
  EXPECT_THROW(build_effect(arm.context(), {"backlash", {4}}), ModelError);
  EXPECT_THROW(build_effect(arm.context(), {"joint_coupling", {5, 4}}), ModelError);
  EXPECT_NO_THROW(build_effect(arm.context(), {"joint_coupling", {4, 3}}));
  EXPECT_NO_THROW(build_effect(arm.context(), {"joint_compliance", {4}}));
}

std::string first_wave(const json& robot, int driving) {
  const Measured arm(robot);
  const EffectTerms terms = build_effect(arm.context(), {"coupling_harmonics", {4, driving}});
  return terms.parameters.front().terms.front().basis.to_string();
}

TEST(PassiveJoint, CouplingHarmonics_FollowTheDrivingLinksAngle) {
  EXPECT_EQ(first_wave(palletiser(false), 2), "sin(q2)");
  EXPECT_EQ(first_wave(palletiser(false), 3), "sin(q3 + q2)");
  // If axis 3's motor turns link 3 against the base, that angle is q3 itself.
  EXPECT_EQ(first_wave(palletiser(true), 2), "sin(q2)");
  EXPECT_EQ(first_wave(palletiser(true), 3), "sin(q3)");

  const Measured arm(palletiser(true));
  std::vector<std::vector<int>> pairs;
  for (const EffectRequest& request : find_effect("coupling_harmonics").tried(arm.context()))
    pairs.push_back(request.joints);
  for (const std::vector<int>& pair : {std::vector{4, 2}, std::vector{4, 3}})
    EXPECT_EQ(std::ranges::count(pairs, pair), 1) << pair[1];
}

// The bars of axis 3 turn link 3; those of the flange follow link 3 and keep the flange level.
TEST(PassiveJoint, ParallelogramError_IsUndoneAtThePassiveJoint) {
  const Measured arm(palletiser(true));
  for (const Parameter& p : build_effect(arm.context(), {"parallelogram", {}}).parameters) {
    ASSERT_EQ(p.terms.size(), 2U) << p.name;
    EXPECT_EQ(p.terms[1].coordinate.index, 3);
    EXPECT_DOUBLE_EQ(p.terms[1].weight, -p.terms[0].weight);
  }
}

TEST(PassiveJoint, LimitsApplyToTheAngleGivenByTheCouplings) {
  json content = palletiser(false);
  content["kinematics"]["joints"][3]["limits"] = {-0.5, 0.5};
  const Robot robot = Robot::from_json(content);
  Kinematics kinematics(robot, 1);
  kinematics.set_tool(0, Pose::Identity());
  EXPECT_EQ(joint_ranges(robot, {}).row(3), Eigen::RowVector2d::Zero());
  const double level[] = {0.0, 1.0, -1.2, 0.0, 0.0}, folded[] = {0.0, 1.0, -0.2, 0.0, 0.0};
  EXPECT_TRUE(admissible(kinematics, level, Cell{}));
  EXPECT_FALSE(admissible(kinematics, folded, Cell{}));
}

}  // namespace
}  // namespace armtrue
