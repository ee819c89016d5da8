#include "fitter/model/state.h"

#include <gtest/gtest.h>

#include "fitter/testing/arms.h"
#include "fitter/testing/reference_kinematics.h"

namespace armtrue {
namespace {

using nlohmann::json;
using testing::Random;

const Eigen::Vector3d kPayloadPoint(0.12, -0.03, 0.2);

// A heavy arm with a coupling, tilted gravity and a sliding joint: everything on which the signs of
// gravity torques depend.
struct Heavy {
  Robot robot;
  State::Columns columns;
  std::unique_ptr<State> state;

  explicit Heavy(bool with_links = true) {
    Random random(91);
    json content = testing::random_chain(random, 5, {2});
    content["coupling"] = {{{"joint", 4}, {"driving", 2}, {"ratio", -0.7}}};
    content["gravity"] = {0.7, -1.1, -9.7};
    if (with_links) testing::add_links(random, content);
    robot = Robot::from_json(content);
    columns = testing::random_joints(robot, 5, random);
    testing::add_recorded_state(robot, random, columns);
    state = std::make_unique<State>(robot, columns, kPayloadPoint);
  }

  // Poses of all frames in the base for motor-side shifts `motor`, by the independent second
  // implementation of the chain.
  std::vector<Eigen::Matrix4d> frames(std::size_t row, const std::vector<double>& motor) const {
    std::vector<Eigen::Matrix4d> result;
    const int n = robot.joint_count();
    Eigen::Matrix4d pose = Eigen::Matrix4d::Identity();
    for (int k = 0; k < n; ++k) {
      double variable = robot.joints[static_cast<std::size_t>(k)].offset;
      for (int j = 0; j < n; ++j) {
        variable +=
            robot.coupling(k, j) *
            (state->joints()[row * static_cast<std::size_t>(n) + static_cast<std::size_t>(j)] +
             motor[static_cast<std::size_t>(j)]);
      }
      double v[6] = {0, 0, 0, 0, 0, 0};
      v[robot.joints[static_cast<std::size_t>(k)].prismatic ? 2 : 5] = variable;
      pose = pose * robot.joints[static_cast<std::size_t>(k)].fixed.matrix() *
             testing::virtual_joint(v);
      result.push_back(pose);
    }
    return result;
  }

  double potential(std::size_t row, const std::vector<double>& motor) const {
    const auto all = frames(row, motor);
    double energy = 0.0;
    for (std::size_t k = 0; k < all.size(); ++k) {
      energy -= robot.links[k].mass *
                robot.gravity.dot((all[k] * robot.links[k].com_in_frame.homogeneous()).head<3>());
    }
    const Eigen::Vector4d point = all.back() * robot.end.matrix() * kPayloadPoint.homogeneous();
    return energy - columns.at("payload")[row] * robot.gravity.dot(point.head<3>());
  }
};

// The torque of gravity is the decrease of potential energy per motor angle: virtual work, coupling
// included.
TEST(State, GravityTorquesMatchVirtualWork) {
  const Heavy arm;
  for (std::size_t row = 0; row < 5; ++row) {
    for (std::size_t k = 0; k < 5; ++k) {
      std::vector<double> up(5, 0.0), down(5, 0.0);
      up[k] = 1e-5;
      down[k] = -1e-5;
      const double work = -(arm.potential(row, up) - arm.potential(row, down)) / 2e-5;
      const double tau = arm.state->column("tau" + std::to_string(k + 1))[row];
      EXPECT_NEAR(tau, work, 1e-5 * std::max(1.0, std::abs(work))) << "joint " << k + 1;
    }
  }
}

TEST(State, MomentsMatchThoseOfTheWeightsBeyondTheJoint) {
  const Heavy arm;
  for (std::size_t row = 0; row < 5; ++row) {
    const auto frames = arm.frames(row, std::vector<double>(5, 0.0));
    for (std::size_t k = 0; k < 5; ++k) {
      Eigen::Vector3d moment = Eigen::Vector3d::Zero();
      const Eigen::Vector3d origin = frames[k].block<3, 1>(0, 3);
      for (std::size_t j = k; j < 5; ++j) {
        const Eigen::Vector3d com =
            (frames[j] * arm.robot.links[j].com_in_frame.homogeneous()).head<3>();
        moment += (com - origin).cross(arm.robot.links[j].mass * arm.robot.gravity);
      }
      const Eigen::Vector3d load =
          (frames[4] * arm.robot.end.matrix() * kPayloadPoint.homogeneous()).head<3>();
      moment += (load - origin).cross(arm.columns.at("payload")[row] * arm.robot.gravity);
      const Eigen::Vector3d in_frame = frames[k].block<3, 3>(0, 0).transpose() * moment;
      const std::string number = std::to_string(k + 1);
      EXPECT_NEAR(arm.state->column("gmx" + number)[row], in_frame.x(),
                  1e-9 * std::max(1.0, moment.norm()));
      EXPECT_NEAR(arm.state->column("gmy" + number)[row], in_frame.y(),
                  1e-9 * std::max(1.0, moment.norm()));
    }
  }
}

// The regressors, weighted with the masses, are the torque: a fit without masses describes the same
// loads as one with masses.
TEST(State, RegressorsAddUpToTheTorques) {
  const Heavy arm;
  const auto sum = [&](const std::string& stem, const std::string& payload_stem, int first,
                       std::size_t row) {
    double total = arm.columns.at("payload")[row] * arm.state->column(payload_stem)[row];
    for (int link = first; link <= 5; ++link) {
      const Link& l = arm.robot.links[static_cast<std::size_t>(link - 1)];
      const Eigen::Vector3d first_moment = l.mass * l.com_in_frame;
      const std::string name = stem + "_" + std::to_string(link) + "_";
      total += l.mass * arm.state->column(name + "m")[row] +
               first_moment.x() * arm.state->column(name + "x")[row] +
               first_moment.y() * arm.state->column(name + "y")[row] +
               first_moment.z() * arm.state->column(name + "z")[row];
    }
    return total;
  };
  for (std::size_t row = 0; row < 5; ++row) {
    for (int k = 1; k <= 5; ++k) {
      const std::string n = std::to_string(k);
      EXPECT_NEAR(sum("u_" + n, "up_" + n, k, row), arm.state->column("tau" + n)[row],
                  1e-9 * 2000.0);
      EXPECT_NEAR(sum("ux_" + n, "upx_" + n, k, row), arm.state->column("gmx" + n)[row],
                  1e-9 * 2000.0);
      EXPECT_NEAR(sum("uy_" + n, "upy_" + n, k, row), arm.state->column("gmy" + n)[row],
                  1e-9 * 2000.0);
    }
    EXPECT_NEAR(sum("ux_0", "upx_0", 1, row), arm.state->column("bmx")[row], 1e-9 * 2000.0);
    EXPECT_NEAR(sum("uy_0", "upy_0", 1, row), arm.state->column("bmy")[row], 1e-9 * 2000.0);
  }
}

TEST(State, MeasuredTorque_IsUsedOnlyWithoutMasses) {
  // A device computes the torque: the sign of a drive or the scale of a sensor must not enter a
  // coefficient.
  for (const bool with_masses : {true, false}) {
    Heavy arm(with_masses);
    arm.columns["tau2"] = {1.0, 2.0, 3.0, 4.0, 5.0};
    const State state(arm.robot, arm.columns, kPayloadPoint);
    if (with_masses) {
      EXPECT_EQ(state.column("tau2"), arm.state->column("tau2"));
    } else {
      EXPECT_EQ(state.column("tau2")[3], 4.0);
    }
  }
}

TEST(State, WithoutMasses_HasRegressorsButNoTorques) {
  const Heavy arm(false);
  EXPECT_FALSE(arm.state->has("tau2"));
  EXPECT_FALSE(arm.state->has("bmx"));
  EXPECT_TRUE(arm.state->has("u_2_3_m"));
  EXPECT_THROW(arm.state->column("tau2"), ModelError);
}

TEST(State, HasAnglesAndTemperature_ButNoUnknownColumns) {
  const Heavy arm;
  for (std::size_t row = 0; row < 5; ++row) {
    const double th4 =
        arm.columns.at("q4")[row] - 0.7 * arm.columns.at("q2")[row] + arm.robot.joints[3].offset;
    EXPECT_NEAR(arm.state->column("th4")[row], th4, 1e-14);
    EXPECT_DOUBLE_EQ(arm.state->column("dT")[row], arm.columns.at("temp_arm")[row] - 20.0);
  }
  for (const char* name : {"th6", "th0", "q9", "tau", "dT_oven", "u_3_2_m", "u_9_9_m", "repeat",
                           "target", "", "u", "up_", "q1x"}) {
    EXPECT_FALSE(arm.state->has(name)) << name;
  }
}

TEST(State, RefusesMissingJointsAndRaggedColumns) {
  Heavy arm;
  State::Columns missing = arm.columns;
  missing.erase("q3");
  EXPECT_THROW(State(arm.robot, missing, kPayloadPoint), ModelError);
  arm.columns["time"].pop_back();
  EXPECT_THROW(State(arm.robot, arm.columns, kPayloadPoint), ModelError);
}

// A noisy measured torque is smoothed to one that the arm's statics can produce. A torque that they
// cannot produce (an external force pulls at the arm) stays as measured.
TEST(State, SmoothTorquesRemovesSensorNoise) {
  for (const double payload : {8.0, 0.0}) {
    Random random(31);
    json content = testing::industrial_arm();
    testing::add_links(random, content);
    const Robot with_masses = Robot::from_json(content);
    content.erase("links");
    const Robot robot = Robot::from_json(content);
    State::Columns columns = testing::random_joints(robot, 300, random);
    for (std::size_t i = 0; i < 300; ++i) columns["payload"].push_back(i % 3 ? 0.0 : payload);
    const Eigen::Vector3d point(0.05, 0.0, 0.1);
    const std::vector<double> exact = State(with_masses, columns, point).column("tau2");
    std::vector<double> read = exact;
    for (double& v : read) v += testing::normal(random, 2.0);
    columns["tau2"] = read;
    State state(robot, columns, point);
    EXPECT_EQ(state.column("tau2"), read);  // in a prediction, rows do not affect each other
    state.smooth_torques();
    double before = 0.0, after = 0.0;
    for (std::size_t i = 0; i < 300; ++i) {
      before += std::pow(read[i] - exact[i], 2);
      after += std::pow(state.column("tau2")[i] - exact[i], 2);
    }
    EXPECT_LT(after, 0.1 * before) << "payload " << payload;

    for (std::size_t i = 0; i < 300; ++i) columns["tau2"][i] = std::sin(40.0 * columns["q1"][i]);
    State unexplained(robot, columns, point);
    unexplained.smooth_torques();
    EXPECT_EQ(unexplained.column("tau2"), columns["tau2"]);
  }
}

}  // namespace
}  // namespace armtrue
