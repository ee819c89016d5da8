#include "fitter/model/poses.h"

#include <gtest/gtest.h>

#include "fitter/testing/arms.h"

namespace armtrue {
namespace {

// Poses of a six-axis arm, by the angle of joint 1 [rad]; all other joints at 0.1.
Poses poses_of(const std::vector<double>& q1, const std::vector<int>& target = {},
               const std::vector<int>& repeat = {}, const std::vector<double>& time = {},
               const std::vector<double>& payload = {}) {
  const Robot robot = Robot::from_json(testing::industrial_arm());
  State::Columns columns;
  for (int k = 2; k <= robot.joint_count(); ++k)
    columns["q" + std::to_string(k)].assign(q1.size(), 0.1);
  columns["q1"] = q1;
  if (!time.empty()) columns["time"] = time;
  if (!payload.empty()) columns["payload"] = payload;
  const State state(robot, columns, Eigen::Vector3d::Zero());
  return find_poses(state, target.empty() ? std::vector<int>(q1.size(), 0) : target, repeat);
}

TEST(FindPoses, EqualJoints_AreOnePose) {
  const Poses poses = poses_of({0.1, 0.2, 0.100004, 0.3, 0.2});
  EXPECT_EQ(poses.pose_of_row, (std::vector<int>{0, 1, 0, 2, 1}));
  EXPECT_EQ(poses.poses, 3);
  EXPECT_TRUE(poses.any_repeated());
}

TEST(FindPoses, JointsFurtherApartThanADriveResolves_AreTwoPoses) {
  EXPECT_EQ(poses_of({0.1, 0.10002}).poses, 2);
  EXPECT_FALSE(poses_of({0.1, 0.10002}).any_repeated());
}

TEST(FindPoses, DeclaredRepeats_AreOnePoseDespiteDifferentJoints) {
  EXPECT_EQ(poses_of({0.1, 0.2, 0.5}, {}, {7, 8, 7}).pose_of_row, (std::vector<int>{0, 1, 0}));
}

TEST(FindPoses, OnePostureWithTwoPayloads_IsTwoPoses) {
  const Poses poses =
      poses_of({0.1, 0.1, 0.2, 0.1, 0.1}, {}, {1, 1, 2, 1, 1}, {}, {0.0, 50.0, 50.0, 50.1, 0.0});
  EXPECT_EQ(poses.posture_of_row, (std::vector<int>{0, 0, 1, 0, 0}));
  EXPECT_EQ(poses.pose_of_row, (std::vector<int>{0, 1, 2, 1, 0}));
  EXPECT_EQ(poses.poses, 3);
}

TEST(FindPoses, ReflectorsReadOneAfterTheOther_AreOneVisit) {
  const Poses poses = poses_of({0.1, 0.1, 0.1, 0.4}, {0, 1, 2, 0});
  EXPECT_EQ(poses.visit_of_row, (std::vector<int>{0, 0, 0, 1}));
}

TEST(FindPoses, UndeclaredReadingsInARow_AreOneVisit) {
  EXPECT_EQ(poses_of({0.1, 0.1, 0.1, 0.4}).visit_of_row, (std::vector<int>{0, 0, 0, 1}));
}

TEST(FindPoses, DeclaredRepeatsInARow_AreSeparateVisits) {
  EXPECT_EQ(poses_of({0.1, 0.1, 0.4}, {}, {1, 1, 2}).visit_of_row, (std::vector<int>{0, 1, 2}));
}

TEST(FindPoses, APoseReachedAgainLater_IsAnotherVisit) {
  const Poses poses = poses_of({0.1, 0.4, 0.1}, {}, {}, {0.0, 10.0, 20.0});
  EXPECT_EQ(poses.visit_of_row, (std::vector<int>{0, 1, 2}));
  EXPECT_EQ(poses.pose_of_row, (std::vector<int>{0, 1, 0}));
}

TEST(FindPoses, FilePartPerReflectorWithoutTime_OrderGivesTheVisits) {
  const Poses poses = poses_of({0.1, 0.4, 0.1, 0.4}, {0, 0, 1, 1});
  EXPECT_EQ(poses.visit_of_row, (std::vector<int>{0, 1, 0, 1}));
}

}  // namespace
}  // namespace armtrue
