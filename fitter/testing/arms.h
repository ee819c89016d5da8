// Arms and measurements for tests: random chains of every kind in the model, drawn from a seed.
#pragma once

#include <Eigen/Core>
#include <nlohmann/json.hpp>
#include <random>
#include <string>
#include <vector>

#include "fitter/design/model.h"
#include "fitter/model/kinematics.h"
#include "fitter/model/robot.h"
#include "fitter/model/state.h"

namespace armtrue::testing {

using Random = std::mt19937_64;

inline double uniform(Random& random, double low, double high) {
  return std::uniform_real_distribution<double>(low, high)(random);
}

inline double normal(Random& random, double sigma) {
  // std::normal_distribution itself does not allow a sigma of 0.
  return sigma * std::normal_distribution<double>(0.0, 1.0)(random);
}

inline Eigen::Vector3d normal3(Random& random, double sigma) {
  return {normal(random, sigma), normal(random, sigma), normal(random, sigma)};
}

// Here and below, each random number is drawn in its own statement: compilers differ in the order
// in which they evaluate a call's arguments, and all of them must make the same arms.
inline Eigen::Matrix3d random_rotation(Random& random) {
  Eigen::Vector4d zyxw;
  for (double& coefficient : zyxw) coefficient = normal(random, 1.0);
  return Eigen::Quaterniond(zyxw[3], zyxw[2], zyxw[1], zyxw[0]).normalized().toRotationMatrix();
}

/// A chain of random fixed transforms, in Craig's convention; joints listed in `prismatic`
/// (0-based) slide.
inline nlohmann::json random_chain(Random& random, int joints,
                                   const std::vector<int>& prismatic = {}) {
  nlohmann::json rows = nlohmann::json::array();
  for (int k = 0; k < joints; ++k) {
    const bool slides = std::find(prismatic.begin(), prismatic.end(), k) != prismatic.end();
    // Twists well away from 0 and 180 degrees: neighbouring axes are neither parallel nor in line.
    const double sign = uniform(random, 0.0, 1.0) < 0.5 ? -1.0 : 1.0;
    const double alpha = sign * uniform(random, 0.5, 1.3);
    nlohmann::json row{{"name", "joint" + std::to_string(k + 1)},
                       {"a", k == 0 ? 0.0 : uniform(random, 0.1, 0.6)},
                       {"alpha", k == 0 ? 0.0 : alpha},
                       {"d", uniform(random, 0.1, 0.5)},
                       {"offset", slides ? 0.2 : uniform(random, -0.5, 0.5)},
                       {"gear_ratio", 100.0 + k}};
    if (slides) row["type"] = "prismatic";
    row["limits"] = slides ? nlohmann::json{-0.4, 0.4} : nlohmann::json{-2.5, 2.5};
    rows.push_back(row);
  }
  return {{"name", "random"}, {"kinematics", {{"convention", "mdh"}, {"joints", rows}}}};
}

/// Link masses and centres of mass of an arm of some tens of kilograms.
inline void add_links(Random& random, nlohmann::json& robot) {
  robot["links"] = nlohmann::json::array();
  for (std::size_t k = 0; k < robot["kinematics"]["joints"].size(); ++k) {
    const Eigen::Vector3d com = normal3(random, 0.15);
    robot["links"].push_back(
        {{"mass", uniform(random, 2.0, 30.0)}, {"com", {com.x(), com.y(), com.z()}}});
  }
}

/// A six-axis arm with a spherical wrist and parallel axes 2 and 3, as most industrial arms have.
inline nlohmann::json industrial_arm() {
  const double half = 1.5707963267948966;
  const auto row = [](double a, double alpha, double d, double offset) {
    return nlohmann::json{{"a", a},           {"alpha", alpha},    {"d", d},
                          {"offset", offset}, {"gear_ratio", 120}, {"limits", {-2.6, 2.6}}};
  };
  nlohmann::json joints{row(0.0, 0.0, 0.6, 0.0),  row(0.3, -half, 0.0, -half),
                        row(0.7, 0.0, 0.0, 0.0),  row(0.1, -half, 0.65, 0.0),
                        row(0.0, half, 0.0, 0.0), row(0.0, -half, 0.15, 0.0)};
  return {{"name", "industrial"}, {"kinematics", {{"convention", "mdh"}, {"joints", joints}}}};
}

/// Uniform joints inside the limits (or ±2.5).
inline State::Columns random_joints(const Robot& robot, std::size_t rows, Random& random) {
  State::Columns columns;
  for (int k = 0; k < robot.joint_count(); ++k) {
    const Joint& joint = robot.joints[static_cast<std::size_t>(k)];
    std::vector<double>& q = columns["q" + std::to_string(k + 1)];
    for (std::size_t i = 0; i < rows; ++i) {
      q.push_back(joint.limited ? uniform(random, joint.lower, joint.upper)
                                : uniform(random, -2.5, 2.5));
    }
  }
  return columns;
}

/// Adds every column that an effect may read, except the joints.
inline void add_recorded_state(const Robot& robot, Random& random, State::Columns& columns) {
  const std::size_t rows = columns.at("q1").size();
  for (std::size_t i = 0; i < rows; ++i) {
    columns["payload"].push_back(static_cast<double>(i % 3) * 5.0);
    columns["time"].push_back(25.0 * static_cast<double>(i));
    columns["temp_arm"].push_back(20.0 + uniform(random, 0.0, 12.0));
    for (int k = 1; k <= robot.joint_count(); ++k) {
      const std::string number = std::to_string(k);
      columns["dir" + number].push_back(uniform(random, 0.0, 1.0) < 0.5 ? -1.0 : 1.0);
      columns["qr" + number].push_back(columns["q" + number][i] + normal(random, 1e-4));
    }
  }
}

/// Writes measured x, y, z (and qw…qz) of poses into columns.
inline void set_measured(const std::vector<Pose>& poses, bool with_rotation,
                         State::Columns& columns) {
  for (const char* name : {"x", "y", "z", "qw", "qx", "qy", "qz"}) columns.erase(name);
  for (const Pose& pose : poses) {
    columns["x"].push_back(pose.translation().x());
    columns["y"].push_back(pose.translation().y());
    columns["z"].push_back(pose.translation().z());
    if (!with_rotation) continue;
    const Eigen::Quaterniond q(pose.linear());
    columns["qw"].push_back(q.w());
    columns["qx"].push_back(q.x());
    columns["qy"].push_back(q.y());
    columns["qz"].push_back(q.z());
  }
}

/// A robot base some metres away, in a random orientation.
inline Pose random_base(Random& random) {
  Pose pose = Pose::Identity();
  pose.linear() = random_rotation(random);
  pose.translation() = normal3(random, 2.0);
  return pose;
}

/// A reflector on the flange.
inline Pose random_tool(Random& random) {
  Pose pose = Pose::Identity();
  pose.linear() = random_rotation(random);
  pose.translation().z() = uniform(random, 0.05, 0.2);
  pose.translation().y() = uniform(random, -0.1, 0.1);
  pose.translation().x() = uniform(random, 0.05, 0.2);
  return pose;
}

/// The initial model: geometry only.
inline nlohmann::json geometry_model() {
  return {{"effects", {"base_frame", "tool_offset", "joint_offset", "link_geometry"}}};
}

}  // namespace armtrue::testing
