#include "fitter/start/align.h"

#include <gtest/gtest.h>

#include <numbers>

#include "fitter/testing/problem.h"

namespace armtrue {
namespace {

using nlohmann::json;
using testing::nothing;
using testing::Problem;
using testing::ProblemOptions;
using testing::Random;

constexpr double kDegrees = std::numbers::pi / 180.0;

// Errors of usual size: tenths of a degree, tenths of a millimetre.
auto field_errors(Random& random) {
  return [&random](const Parameter& p) {
    if (p.effect == "base_frame" || p.effect == "tool_offset") return 0.0;
    return testing::normal(random, p.unit == "m" ? 3e-4 : 1.5e-3);
  };
}

double angle_between(const Pose& a, const Pose& b) {
  return rotation_log(a.linear() * b.linear().transpose()).norm();
}

Alignment align_of(const Robot& robot, const State::Columns& columns) {
  const State state(robot, columns, Eigen::Vector3d::Zero());
  return align(state, Measurements::from_state(state, std::nullopt, 1e-5, 2e-5));
}

// Random arms, bases and reflectors, without an initial guess.
class AlignAnyArm : public ::testing::TestWithParam<int> {};
INSTANTIATE_TEST_SUITE_P(Seeds, AlignAnyArm, ::testing::Range(0, 24));

TEST_P(AlignAnyArm, FindsBaseAndToolWithoutInitialGuess) {
  Random random(static_cast<unsigned>(400 + GetParam()));
  const int joints = 4 + GetParam() % 4;
  const std::vector<int> prismatic = GetParam() % 3 == 0 ? std::vector<int>{1} : std::vector<int>{};
  const json robot = GetParam() % 5 == 4 ? testing::industrial_arm()
                                         : testing::random_chain(random, joints, prismatic);
  ProblemOptions options;
  options.rows = 25;
  options.targets = 1 + GetParam() % 3;
  options.with_rotation = GetParam() % 2 == 1;
  options.noise_m = 1e-5;
  options.noise_rad = 1e-5;
  const Problem p(robot, testing::geometry_model(), options, random, field_errors(random));
  const Alignment found = align(*p.state, p.measurements);
  EXPECT_LT(found.rms_m, 0.02);
  EXPECT_NEAR(found.scale, 1.0, 0.03);
  EXPECT_LT(angle_between(found.measuring_from_base, p.kinematics->base()), 0.05);
  EXPECT_LT((found.measuring_from_base.translation() - p.kinematics->base().translation()).norm(),
            0.08);
  for (int t = 0; t < options.targets; ++t) {
    const Pose& tool = found.flange_from_tool[static_cast<std::size_t>(t)];
    EXPECT_LT((tool.translation() - p.kinematics->tool(t).translation()).norm(), 0.05);
    if (options.with_rotation) {
      EXPECT_LT(angle_between(tool, p.kinematics->tool(t)), 0.05);
    }
  }
}

TEST_P(AlignAnyArm, ArmWithoutErrors_GivesExactResult) {
  Random random(static_cast<unsigned>(500 + GetParam()));
  const Problem p(testing::random_chain(random, 6), testing::geometry_model(), {12}, random,
                  nothing);
  const Alignment found = align(*p.state, p.measurements);
  EXPECT_LT(found.rms_m, 1e-9);
  EXPECT_LT((found.measuring_from_base.matrix() - p.kinematics->base().matrix()).norm(), 1e-7);
  EXPECT_NEAR(found.scale, 1.0, 1e-8);
}

TEST(Align, ReportsMillimetresAsAScale) {
  Random random(21);
  Problem p(testing::industrial_arm(), testing::geometry_model(), {40}, random,
            field_errors(random));
  for (const char* axis : {"x", "y", "z"}) {
    for (double& v : p.columns[axis]) v *= 1000.0;
  }
  const Alignment found = align_of(p.robot, p.columns);
  EXPECT_NEAR(found.scale, 1000.0, 20.0);
  EXPECT_LT((found.flange_from_tool[0].translation() - p.kinematics->tool(0).translation()).norm(),
            0.02);
}

// With degrees read as radians, no base and tool fit: the remaining distance shows the mistake.
TEST(Align, DegreesReadAsRadians_LeaveMoreThanADecimetre) {
  Random random(22);
  Problem p(testing::industrial_arm(), testing::geometry_model(), {60}, random, nothing);
  for (int k = 1; k <= 6; ++k) {
    for (double& v : p.columns["q" + std::to_string(k)]) v /= kDegrees;
  }
  EXPECT_GT(align_of(p.robot, p.columns).rms_m, 0.1);
}

TEST(Align, BumpedReflectors_HardlyMoveTheResult) {
  Random random(23);
  Problem p(testing::industrial_arm(), testing::geometry_model(), {60}, random, nothing);
  for (const std::size_t row : {3u, 17u, 18u, 40u, 55u, 59u}) p.columns["y"][row] += 0.2;
  const Alignment found = align_of(p.robot, p.columns);
  EXPECT_LT((found.measuring_from_base.translation() - p.kinematics->base().translation()).norm(),
            2e-3);
  EXPECT_NEAR(found.residual_m[17], 0.2, 5e-3);
  EXPECT_LT(found.residual_m[16], 5e-3);
}

// Poses in a corner of the cell hardly turn the reflector, but must still give a base near the
// truth.
TEST(Align, CornerOfTheWorkspace_GivesTheTrueBase) {
  Random random(24);
  json robot = testing::industrial_arm();
  for (json& joint : robot["kinematics"]["joints"]) joint["limits"] = {-0.35, 0.35};
  const Problem p(robot, testing::geometry_model(), {40}, random, nothing);
  const Alignment found = align(*p.state, p.measurements);
  EXPECT_LT(found.rms_m, 1e-6);
  EXPECT_LT((found.measuring_from_base.translation() - p.kinematics->base().translation()).norm(),
            1e-3);
}

// If only one joint moves, the tool along its axis and the base about it are undetermined, but the
// result must reproduce the points.
TEST(Align, DegenerateMotionStillReproducesThePoints) {
  Random random(25);
  json robot = testing::industrial_arm();
  for (std::size_t k = 1; k < 6; ++k) robot["kinematics"]["joints"][k]["limits"] = {0.3, 0.3};
  const Problem p(robot, testing::geometry_model(), {20}, random, nothing);
  const Alignment found = align(*p.state, p.measurements);
  EXPECT_LT(found.rms_m, 1e-6);
  EXPECT_TRUE(found.measuring_from_base.matrix().allFinite());
}

TEST(Align, NeverMovingArmIsFinite) {
  Random random(26);
  json robot = testing::industrial_arm();
  for (json& joint : robot["kinematics"]["joints"]) joint["limits"] = {0.3, 0.3};
  const Problem p(robot, testing::geometry_model(), {8}, random, nothing);
  const Alignment found = align(*p.state, p.measurements);
  EXPECT_TRUE(found.measuring_from_base.matrix().allFinite());
  EXPECT_LT(found.rms_m, 1e-6);
}

TEST(Align, RefusesThreeRows) {
  Random random(27);
  const Problem p(testing::industrial_arm(), testing::geometry_model(), {3}, random, nothing);
  EXPECT_THROW(align(*p.state, p.measurements), ModelError);
}

}  // namespace
}  // namespace armtrue
