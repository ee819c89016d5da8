#include "fitter/model/robot.h"

#include <cmath>
#include <nlohmann/json.hpp>
#include <numbers>

#include "fitter/common/dense.h"

namespace armtrue {
namespace {

using nlohmann::json;

Eigen::Vector3d vector3(const json& value) {
  return {value.at(0).get<double>(), value.at(1).get<double>(), value.at(2).get<double>()};
}

// The value of a key; nullptr where it is absent or null.
const json* given(const json& object, const char* key) {
  const auto at = object.find(key);
  return at == object.end() || at->is_null() ? nullptr : &*at;
}

Pose pose_from_json(const json& value) {
  Eigen::Vector3d xyz = Eigen::Vector3d::Zero();
  Eigen::Vector3d rpy = Eigen::Vector3d::Zero();
  if (const json* there = given(value, "xyz")) xyz = vector3(*there);
  if (const json* there = given(value, "rpy")) rpy = vector3(*there);
  return pose_from_xyz_rpy(xyz, rpy);
}

Pose rotation_x(double angle) { return Pose(Eigen::AngleAxisd(angle, Eigen::Vector3d::UnitX())); }
Pose rotation_z(double angle) { return Pose(Eigen::AngleAxisd(angle, Eigen::Vector3d::UnitZ())); }
Pose translation(double x, double z) { return Pose(Eigen::Translation3d(x, 0.0, z)); }

double optional_number(const json& object, const char* key, double otherwise) {
  const json* value = given(object, key);
  return value ? value->get<double>() : otherwise;
}

Joint common_fields(const json& row) {
  Joint joint;
  joint.prismatic = row.value("type", "revolute") == "prismatic";
  joint.offset = optional_number(row, "offset", 0.0);
  const double ratio = optional_number(row, "gear_ratio", 0.0);
  if (joint.prismatic) {
    // Older files state gear_ratio for a sliding joint: motor radians per metre.
    const double of_ratio = ratio != 0.0 ? 2.0 * std::numbers::pi / std::abs(ratio) : 0.0;
    joint.lead = optional_number(row, "lead", of_ratio);
  } else {
    joint.gear_ratio = std::abs(ratio);
  }
  joint.passive = row.value("passive", false);
  if (const json* limits = given(row, "limits")) {
    limits->at(0).get_to(joint.lower);
    limits->at(1).get_to(joint.upper);
    joint.limited = true;
  }
  return joint;
}

// For a prismatic row the variable and its offset add to d (docs/model.md), so d itself stays in
// the fixed part.
void build_chain(const json& kinematics, Robot& robot, std::vector<Pose>& frame_from_listed_frame) {
  const auto convention = kinematics.at("convention").get<std::string>();
  Pose carried = Pose::Identity();
  for (const json& row : kinematics.at("joints")) {
    Joint joint = common_fields(row);
    if (convention == "chain") {
      joint.fixed = pose_from_json(row);
      frame_from_listed_frame.push_back(Pose::Identity());
    } else {
      const double a = optional_number(row, "a", 0.0);
      const double alpha = optional_number(row, "alpha", 0.0);
      const double d = optional_number(row, "d", 0.0);
      const Pose turned = rotation_z(optional_number(row, "theta", 0.0));  // prismatic rows only
      if (convention == "mdh") {
        joint.fixed = rotation_x(alpha) * translation(a, d) * turned;
        frame_from_listed_frame.push_back(Pose::Identity());
      } else if (convention == "dh") {
        joint.fixed = carried * turned;
        carried = translation(a, d) * rotation_x(alpha);
        frame_from_listed_frame.push_back(carried);
      } else {
        throw ModelError("robot: kinematics.convention is '" + convention +
                         "', expected mdh, dh or chain");
      }
    }
    robot.joints.push_back(joint);
  }
  if (robot.joints.empty())
    throw ModelError("robot: kinematics.joints is empty, expected at least one joint");
  robot.end = carried;
  if (kinematics.contains("end")) robot.end = pose_from_json(kinematics["end"]);
}

std::string passive_joint(int joint) {
  return "robot: joint " + std::to_string(joint) + " is passive";
}

// Checks a row of `coupling` for passive joints.
void check_passive_in(const Robot& robot, int driven, int driving, bool is_reported) {
  if (robot.is_passive(driving)) {
    throw ModelError(passive_joint(driving) + ", but coupling has it drive joint " +
                     std::to_string(driven) + ", expected a joint with a motor");
  }
  if (robot.is_passive(driven) && is_reported) {
    throw ModelError(passive_joint(driven) +
                     ", but its coupling is of kind controller, expected mechanical");
  }
}

void check_passive_driven(const Robot& robot) {
  for (int k = 1; k <= robot.joint_count(); ++k) {
    if (!robot.is_passive(k)) continue;
    if (robot.joints[static_cast<std::size_t>(k - 1)].gear_ratio != 0.0)
      throw ModelError(passive_joint(k) + ", but has a gear_ratio, expected none: it has no motor");
    if (robot.coupling.row(k - 1).isApprox(Eigen::RowVectorXd::Unit(robot.joint_count(), k - 1)))
      throw ModelError(passive_joint(k) + ", but no coupling drives it, expected at least one");
  }
}

}  // namespace

int joint_number(const json& value, int most, const std::string& where) {
  // Compared as double: converting a value that no int holds is undefined.
  const double number = value.get<double>();
  if (!(number >= 1.0 && number <= most) || number != std::floor(number)) {
    throw ModelError(where + " names joint " + value.dump() + ", expected 1 to " +
                     std::to_string(most));
  }
  return static_cast<int>(number);
}

Pose pose_from_xyz_rpy(const Eigen::Vector3d& xyz, const Eigen::Vector3d& rpy) {
  Pose pose = Pose::Identity();
  pose.linear() = (Eigen::AngleAxisd(rpy.z(), Eigen::Vector3d::UnitZ()) *
                   Eigen::AngleAxisd(rpy.y(), Eigen::Vector3d::UnitY()) *
                   Eigen::AngleAxisd(rpy.x(), Eigen::Vector3d::UnitX()))
                      .toRotationMatrix();
  pose.translation() = xyz;
  return pose;
}

Eigen::Vector3d rpy_from_rotation(const Eigen::Matrix3d& r) {
  const double pitch = std::atan2(-r(2, 0), std::hypot(r(0, 0), r(1, 0)));
  if (std::hypot(r(0, 0), r(1, 0)) < 1e-12) {
    // Gimbal lock: only roll ± yaw is defined, so yaw is put to zero.
    return {std::atan2(-r(1, 2), r(1, 1)), pitch, 0.0};
  }
  return {std::atan2(r(2, 1), r(2, 2)), pitch, std::atan2(r(1, 0), r(0, 0))};
}

Eigen::RowVectorXd Robot::followed_links(int joint) const {
  const int n = joint_count();
  std::vector<int> driven_by_motors;
  for (int k = 0; k < n; ++k) {
    if (!joints[static_cast<std::size_t>(k)].passive) driven_by_motors.push_back(k);
  }
  const Eigen::MatrixXd driven = coupling(driven_by_motors, driven_by_motors);
  const Eigen::VectorXd own = coupling(joint - 1, driven_by_motors).transpose();
  Eigen::RowVectorXd followed = Eigen::RowVectorXd::Zero(n);
  followed(driven_by_motors) = least_squares(driven.transpose(), own).transpose();
  return followed;
}

double Robot::reach() const {
  double sum = end.translation().norm();
  for (const Joint& joint : joints) {
    sum += joint.fixed.translation().norm();
    if (joint.prismatic && joint.limited)
      sum += std::max(std::abs(joint.lower), std::abs(joint.upper));
  }
  return sum;
}

Robot Robot::from_json(const json& content) {
  Robot robot;
  std::vector<Pose> frame_from_listed_frame;
  build_chain(content.at("kinematics"), robot, frame_from_listed_frame);
  const int n = robot.joint_count();

  robot.coupling = Eigen::MatrixXd::Identity(n, n);
  if (const json* coupling = given(content, "coupling")) {
    for (const json& row : *coupling) {
      const int driven = joint_number(row.at("joint"), n, "robot: coupling");
      const int driving = joint_number(row.at("driving"), n, "robot: coupling");
      const bool is_reported = row.value("kind", "mechanical") == "controller";
      check_passive_in(robot, driven, driving, is_reported);
      // It affects only what the controller reports; columns hold the drives' angles.
      if (is_reported) continue;
      robot.coupling(driven - 1, driving - 1) += row.at("ratio").get<double>();
    }
  }
  check_passive_driven(robot);
  if (const json* links = given(content, "links"); links && !links->empty()) {
    if (static_cast<int>(links->size()) != n) {
      throw ModelError("robot: links has " + std::to_string(links->size()) + " entries, expected " +
                       std::to_string(n));
    }
    for (int k = 0; k < n; ++k) {
      const json& link = (*links)[k];
      robot.links.push_back(
          {link.at("mass").get<double>(), frame_from_listed_frame[k] * vector3(link.at("com"))});
    }
  }
  if (const json* gravity = given(content, "gravity")) robot.gravity = vector3(*gravity);
  if (const json* tool = given(content, "tool")) robot.flange_from_tool = pose_from_json(*tool);
  if (content.contains("targets")) {
    for (const json& pose : content["targets"])
      robot.flange_from_target.push_back(pose_from_json(pose));
  }
  if (content.contains("payload")) robot.payload_point = vector3(content["payload"].at("com"));
  if (const json* base = given(content, "base")) robot.measuring_from_base = pose_from_json(*base);
  if (const json* temperature = given(content, "temperature")) {
    robot.temperature_reference = optional_number(*temperature, "reference", 20.0);
    robot.sensors = temperature->value("sensors", std::vector<std::string>{});
  }
  if (const json* linkage = given(content, "linkage")) {
    const json& joints = linkage->at("joints");
    robot.parallelogram = Parallelogram{joint_number(joints.at(0), n, "robot: linkage.joints"),
                                        joint_number(joints.at(1), n, "robot: linkage.joints"),
                                        linkage->at("angle").get<double>()};
  }
  return robot;
}

}  // namespace armtrue
