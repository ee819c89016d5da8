#include "fitter/plan/cell.h"

#include <gtest/gtest.h>

#include <cmath>
#include <nlohmann/json.hpp>
#include <numbers>

namespace armtrue {
namespace {

using nlohmann::json;

// Two links of a metre in a plane, the tool half a metre beyond: every place can be worked out by
// hand.
json planar() {
  const auto joint = [](const char* name, double x) {
    return json{{"name", name},     {"type", "revolute"}, {"xyz", {x, 0.0, 0.0}},
                {"rpy", {0, 0, 0}}, {"offset", 0.0},      {"limits", {-2.0, 2.0}}};
  };
  return {{"name", "planar"},
          {"kinematics",
           {{"convention", "chain"},
            {"joints", {joint("A1", 0.0), joint("A2", 1.0)}},
            {"end", {{"xyz", {1.0, 0.0, 0.0}}, {"rpy", {0, 0, 0}}}}}}};
}

Pose tool() { return Pose(Eigen::Translation3d(0.5, 0.0, 0.0)); }

bool allowed(const json& cell, double q1, double q2) {
  const Robot robot = Robot::from_json(planar());
  Kinematics kinematics(robot, 1);
  kinematics.set_tool(0, tool());
  const double q[] = {q1, q2};
  return admissible(kinematics, q, Cell::from_json(cell));
}

TEST(Cell, BoxLimitsTheToolPoint) {
  const json cell{{"box", {{2.4, 2.6}, {-0.1, 0.1}, {-0.1, 0.1}}}};
  EXPECT_TRUE(allowed(cell, 0.0, 0.0));  // stretched along x: at 2.5 m
  EXPECT_FALSE(allowed(cell, 0.2, 0.0));
}

TEST(Cell, FloorLimitsJointsAndTool) {
  json upright = planar();
  // Turned so that the plane of the arm stands upright: joint angles tilt it in x and z.
  upright["kinematics"]["joints"][0]["rpy"] = {-std::numbers::pi / 2, 0.0, 0.0};
  const Robot robot = Robot::from_json(upright);
  Kinematics kinematics(robot, 1);
  kinematics.set_tool(0, tool());
  const Cell cell = Cell::from_json({{"floor", 0.0}});
  // Elbow up and tool up; elbow down with the tool up again; tool below with the elbow up.
  const auto heights = [&](double q1, double q2) {
    const double q[] = {q1, q2};
    return admissible(kinematics, q, cell);
  };
  const bool up = heights(-0.5, 0.0), down = heights(0.5, 0.0);
  EXPECT_NE(up, down);
  const double sign = up ? -1.0 : 1.0;
  EXPECT_FALSE(heights(-sign * 0.5, sign * 1.5));  // elbow below, tool above
  EXPECT_FALSE(heights(sign * 0.3, -sign * 1.5));  // elbow above, tool below
}

TEST(Cell, SightIsLimitedByArmAndReflectorOpening) {
  // The arm folds back over itself: the tool lies half a metre off the base, behind the elbow.
  const json side{{"tracker", {0.0, 5.0, 0.0}}, {"clearance", 0.1}};
  EXPECT_TRUE(allowed(side, 0.0, 0.0));
  const json along{{"tracker", {-5.0, 0.0, 0.0}}, {"clearance", 0.1}};
  EXPECT_FALSE(allowed(along, 0.0, 0.0));  // looks along both links
  json facing = side;
  facing["opening"] = {0.0, 1.0, 0.0};
  facing["acceptance"] = 0.6;
  EXPECT_TRUE(allowed(facing, 0.0, 0.0));
  facing["opening"] = {0.0, -1.0, 0.0};
  EXPECT_FALSE(allowed(facing, 0.0, 0.0));
}

TEST(Cell, InvalidCell_ThrowsModelError) {
  EXPECT_THROW(Cell::from_json({{"box", {{1.0, 0.0}, {0.0, 1.0}, {0.0, 1.0}}}}), ModelError);
  EXPECT_THROW(Cell::from_json({{"tracker", {1.0, 2.0}}}), ModelError);
  EXPECT_THROW(Cell::from_json({{"opening", {0.0, 0.0, 0.0}}}), ModelError);
  EXPECT_THROW(Cell::from_json({{"clearance", -1.0}}), ModelError);
}

TEST(JointRanges, AreLimitsOrRecordedRangesLessAMargin) {
  json robot_json = planar();
  robot_json["kinematics"]["joints"][1].erase("limits");
  const Robot robot = Robot::from_json(robot_json);
  const Eigen::MatrixX2d ranges = joint_ranges(robot, {0.0, -1.0, 0.0, 1.0});
  EXPECT_NEAR(ranges(0, 0), -2.0 + 0.08, 1e-12);
  EXPECT_NEAR(ranges(1, 1), 1.0 - 0.04, 1e-12);
  EXPECT_NEAR(joint_ranges(robot, {})(1, 1), std::numbers::pi * 0.96, 1e-12);
  robot_json["kinematics"]["joints"][1]["type"] = "prismatic";
  EXPECT_THROW(joint_ranges(Robot::from_json(robot_json), {}), ModelError);
}

TEST(ReachablePoses, StayInRangesAndCell_OnlyEdgeSpreadIsOftenAtEnds) {
  const Robot robot = Robot::from_json(planar());
  const Eigen::MatrixX2d ranges = joint_ranges(robot, {});
  const Cell cell = Cell::from_json({{"box", {{0.0, 3.0}, {-3.0, 3.0}, {-1.0, 1.0}}}});
  Kinematics kinematics(robot, 1);
  kinematics.set_tool(0, tool());
  for (const Spread spread : {Spread::kUniform, Spread::kEdges}) {
    const auto poses = reachable_poses(robot, tool(), cell, ranges, spread, 300, 7);
    int at_ends = 0;
    for (Eigen::Index i = 0; i < poses.rows(); ++i) {
      EXPECT_TRUE(admissible(kinematics, poses.row(i).data(), cell));
      for (int k = 0; k < 2; ++k) {
        EXPECT_GE(poses(i, k), ranges(k, 0));
        EXPECT_LE(poses(i, k), ranges(k, 1));
        at_ends += poses(i, k) == ranges(k, 0) || poses(i, k) == ranges(k, 1) ? 1 : 0;
      }
    }
    EXPECT_EQ(at_ends > 100, spread == Spread::kEdges);
  }
  const Cell closed = Cell::from_json({{"box", {{50.0, 51.0}, {0.0, 1.0}, {0.0, 1.0}}}});
  EXPECT_THROW(reachable_poses(robot, tool(), closed, ranges, Spread::kUniform, 5, 1), ModelError);
}

}  // namespace
}  // namespace armtrue
