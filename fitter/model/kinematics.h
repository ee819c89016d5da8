// Forward kinematics of the unified model and its geometric Jacobian over every coordinate.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "fitter/model/coordinate.h"
#include "fitter/model/robot.h"

namespace armtrue {

/// so(3) exponential and its left Jacobian (Barfoot, State Estimation for Robotics, 7.1.3).
Eigen::Matrix3d rotation_exp(const Eigen::Vector3d& r);
Eigen::Matrix3d left_jacobian(const Eigen::Vector3d& r);
/// Inverse of rotation_exp; angle in [0, π].
Eigen::Vector3d rotation_log(const Eigen::Matrix3d& rotation);

/// Evaluates measuring_from_tool and its derivative by all coordinates at one commanded pose.
/// Not thread-safe: it holds its own scratch memory, so that evaluating thousands of poses
/// allocates nothing.
class Kinematics {
 public:
  Kinematics(const Robot& robot, int targets);

  /// Reference poses on which the base and tool coordinates act.
  void set_base(const Pose& measuring_from_base) { measuring_from_base_ = measuring_from_base; }
  void set_tool(int target, const Pose& flange_from_tool) {
    flange_from_tool_[static_cast<std::size_t>(target)] = flange_from_tool;
  }
  const Pose& base() const { return measuring_from_base_; }
  const Pose& tool(int target) const { return flange_from_tool_[static_cast<std::size_t>(target)]; }
  int targets() const { return layout_.targets; }
  const CoordinateLayout& layout() const { return layout_; }
  const Robot& robot() const { return robot_; }

  /// Pose of target `target` for motor-side joints q (n) and coordinate values (layout().size()).
  Pose forward(const double* q, const double* coordinates, int target);
  /// Also fills `jacobian` (6 × layout().size(), rows: position, rotation as a left perturbation in
  /// the measuring frame).
  Pose forward(const double* q, const double* coordinates, int target,
               Eigen::Matrix<double, 6, Eigen::Dynamic>& jacobian);
  /// Frames 1…n (docs/model.md, section "Chain") of the pose evaluated last, in the measuring
  /// frame.
  const std::vector<Pose>& frames() const { return frame_; }

 private:
  const Robot& robot_;
  CoordinateLayout layout_;
  Pose measuring_from_base_ = Pose::Identity();
  std::vector<Pose> flange_from_tool_;
  std::vector<Pose> before_joint_;  // after F_k, before J_k turns
  std::vector<Pose> frame_;         // frame k, before V_k
  Pose base_reference_ = Pose::Identity();
  Pose tool_reference_ = Pose::Identity();
  Eigen::VectorXd link_angle_;
};

}  // namespace armtrue
