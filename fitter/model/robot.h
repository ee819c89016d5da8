// The nominal arm: its chain in the internal form of docs/model.md, masses, limits, sensors.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

namespace armtrue {

/// Thrown for content that contradicts itself or the data; the message is one sentence for the
/// user.
class ModelError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

using Pose = Eigen::Isometry3d;

/// Pose from position [m] and fixed-axes roll, pitch, yaw [rad] (URDF's rpy).
Pose pose_from_xyz_rpy(const Eigen::Vector3d& xyz, const Eigen::Vector3d& rpy);
/// Fixed-axes roll, pitch, yaw [rad] of a rotation.
Eigen::Vector3d rpy_from_rotation(const Eigen::Matrix3d& rotation);

struct Joint {
  bool prismatic = false;
  Pose fixed =
      Pose::Identity();  ///< F_k: from frame k−1 to where joint k turns about (slides along) its z
  double offset = 0.0;   ///< added to the joint variable [rad or m]
  double gear_ratio = 0.0;  ///< of a joint that turns: motor turns per joint turn, without
                            ///< sign; 0 where unknown
  double lead = 0.0;  ///< of a joint that slides: travel per turn of its screw or pinion [m]; or 0
  double lower = 0.0, upper = 0.0;
  bool limited = false;
  /// A passive joint has no motor: rods or gears from other joints move it. Its motor side stands
  /// at zero, so that the couplings give its link angle (and `lower`, `upper` limit that).
  bool passive = false;
};

struct Link {
  double mass = 0.0;                                       ///< [kg]
  Eigen::Vector3d com_in_frame = Eigen::Vector3d::Zero();  ///< centre of mass in frame k [m]
};

struct Parallelogram {
  int crank_joint = 2, arm_joint = 3;  ///< 1-based
  double angle = 0.0;                  ///< β at link angle 3 = 0 [rad]
};

/// The content of robot.yaml, built from its normalised form.
struct Robot {
  std::vector<Joint> joints;
  Pose end = Pose::Identity();  ///< F_end
  Eigen::MatrixXd coupling;     ///< link angles = coupling · motor-side angles + offsets (n × n)
  std::vector<Link> links;      ///< empty where no masses are known
  Eigen::Vector3d gravity{0.0, 0.0, -9.81};
  std::optional<Pose> flange_from_tool;          ///< nominal tool, where given
  std::vector<Pose> flange_from_target;          ///< nominal place of each reflector, where given
  std::optional<Eigen::Vector3d> payload_point;  ///< in the flange, where not the tool point [m]
  std::optional<Pose> measuring_from_base;       ///< nominal base, where given
  double temperature_reference = 20.0;           ///< [°C]
  std::vector<std::string> sensors;
  std::optional<Parallelogram> parallelogram;

  int joint_count() const { return static_cast<int>(joints.size()); }
  /// By the joint's number, from 1; false for a number that the arm does not have.
  bool is_passive(int joint) const {
    return joint <= joint_count() && joints[static_cast<std::size_t>(joint - 1)].passive;
  }
  /// Link angle of passive joint `joint` per link angle of the joints with motors (zero elsewhere).
  Eigen::RowVectorXd followed_links(int joint) const;
  /// Nominal place of reflector `target`; nullopt if it must be fitted.
  std::optional<Pose> nominal_tool(int target) const {
    if (!flange_from_target.empty()) return flange_from_target.at(static_cast<std::size_t>(target));
    return flange_from_tool;
  }
  /// Distance that the arm can span at most: sum of the lengths of its links [m].
  double reach() const;

  /// From robot.yaml's content as JSON (mdh, dh or chain). Throws ModelError.
  static Robot from_json(const nlohmann::json& content);
};

/// A joint by its number, 1 to `most`. Throws ModelError that begins with `where`.
int joint_number(const nlohmann::json& value, int most, const std::string& where);

}  // namespace armtrue
