#include "fitter/model/kinematics.h"

#include <cmath>

namespace armtrue {
namespace {

Eigen::Matrix3d skew(const Eigen::Vector3d& v) {
  Eigen::Matrix3d m;
  m << 0.0, -v.z(), v.y(), v.z(), 0.0, -v.x(), -v.y(), v.x(), 0.0;
  return m;
}

// sin x / x, (1 − cos x) / x², (x − sin x) / x³; near zero by their series.
struct Ratios {
  double first, second, third;
};
Ratios ratios_of(double x2) {
  if (x2 <= 1e-4) {
    return {1.0 - x2 / 6.0 + x2 * x2 / 120.0, 0.5 - x2 / 24.0 + x2 * x2 / 720.0,
            1.0 / 6.0 - x2 / 120.0 + x2 * x2 / 5040.0};
  }
  const double x = std::sqrt(x2);
  return {std::sin(x) / x, (1.0 - std::cos(x)) / x2, (x - std::sin(x)) / (x2 * x)};
}

bool is_zero(const double* v) { return v[0] == 0.0 && v[1] == 0.0 && v[2] == 0.0; }

// pose · Trans(t) · exp(r), skipping zero parts: most virtual joints have only one or two
// coordinates.
void apply_virtual_joint(const double* v, Pose& pose) {
  if (!is_zero(v)) pose.translation() += pose.linear() * Eigen::Vector3d(v[0], v[1], v[2]);
  if (!is_zero(v + 3))
    pose.linear() = pose.linear() * rotation_exp(Eigen::Vector3d(v[3], v[4], v[5]));
}

// pose · F without the homogeneous row.
void apply_fixed(const Pose& fixed, Pose& pose) {
  pose.translation() += pose.linear() * fixed.translation();
  pose.linear() = pose.linear() * fixed.linear();
}

}  // namespace

Eigen::Matrix3d rotation_exp(const Eigen::Vector3d& r) {
  const Eigen::Matrix3d k = skew(r);
  const Ratios ratios = ratios_of(r.squaredNorm());
  return Eigen::Matrix3d::Identity() + ratios.first * k + ratios.second * k * k;
}

Eigen::Matrix3d left_jacobian(const Eigen::Vector3d& r) {
  const Eigen::Matrix3d k = skew(r);
  const Ratios ratios = ratios_of(r.squaredNorm());
  return Eigen::Matrix3d::Identity() + ratios.second * k + ratios.third * k * k;
}

Eigen::Vector3d rotation_log(const Eigen::Matrix3d& rotation) {
  const Eigen::AngleAxisd angle_axis(rotation);
  return angle_axis.angle() * angle_axis.axis();
}

Kinematics::Kinematics(const Robot& robot, int targets)
    : robot_(robot),
      layout_{robot.joint_count(), targets},
      flange_from_tool_(static_cast<std::size_t>(targets), Pose::Identity()),
      before_joint_(robot.joints.size()),
      frame_(robot.joints.size()),
      link_angle_(robot.joint_count()) {}

Pose Kinematics::forward(const double* q, const double* coordinates, int target) {
  const int n = layout_.joints;
  for (int k = 0; k < n; ++k) {
    double angle = robot_.joints[static_cast<std::size_t>(k)].offset;
    for (int j = 0; j < n; ++j) {
      const double c = robot_.coupling(k, j);
      if (c != 0.0) angle += c * (q[j] + coordinates[layout_.motor(j)]);
    }
    link_angle_[k] = angle;
  }
  Pose pose = measuring_from_base_;
  base_reference_ = pose;
  apply_virtual_joint(coordinates + layout_.base(0), pose);
  for (int k = 0; k < n; ++k) {
    const auto i = static_cast<std::size_t>(k);
    const Joint& joint = robot_.joints[i];
    apply_fixed(joint.fixed, pose);
    if (joint.prismatic) {
      pose.translation() += pose.linear().col(2) * link_angle_[k];
    } else {
      const double c = std::cos(link_angle_[k]);
      const double s = std::sin(link_angle_[k]);
      const Eigen::Vector3d x = pose.linear().col(0);
      const Eigen::Vector3d y = pose.linear().col(1);
      pose.linear().col(0) = c * x + s * y;
      pose.linear().col(1) = c * y - s * x;
    }
    frame_[i] = pose;
    apply_virtual_joint(coordinates + layout_.link(k, 0), pose);
  }
  apply_fixed(robot_.end, pose);
  apply_fixed(flange_from_tool_[static_cast<std::size_t>(target)], pose);
  tool_reference_ = pose;
  apply_virtual_joint(coordinates + layout_.tool(target, 0), pose);
  return pose;
}

Pose Kinematics::forward(const double* q, const double* coordinates, int target,
                         Eigen::Matrix<double, 6, Eigen::Dynamic>& jacobian) {
  const Pose tool = forward(q, coordinates, target);
  const Eigen::Vector3d point = tool.translation();
  const int n = layout_.joints;
  jacobian.resize(6, layout_.size());

  // V = Trans(t) exp(r): translations move along the frame's axes; a change dr turns by R·J_l(r)·dr
  // about the moved origin.
  const auto virtual_joint = [&](const Pose& frame, int first) {
    const Eigen::Matrix3d& rotation = frame.linear();
    const double* v = coordinates + first;
    jacobian.block<3, 3>(0, first) = rotation;
    jacobian.block<3, 3>(3, first).setZero();
    Eigen::Vector3d arm = point - frame.translation();
    if (!is_zero(v)) arm -= rotation * Eigen::Vector3d(v[0], v[1], v[2]);
    const Eigen::Matrix3d axes =
        is_zero(v + 3)
            ? rotation
            : Eigen::Matrix3d(rotation * left_jacobian(Eigen::Vector3d(v[3], v[4], v[5])));
    for (int c = 0; c < 3; ++c) {
      jacobian.block<3, 1>(0, first + 3 + c) = axes.col(c).cross(arm);
      jacobian.block<3, 1>(3, first + 3 + c) = axes.col(c);
    }
  };

  virtual_joint(base_reference_, layout_.base(0));
  jacobian.leftCols(n).setZero();
  for (int k = 0; k < n; ++k) {
    const Pose& frame = frame_[static_cast<std::size_t>(k)];
    virtual_joint(frame, layout_.link(k, 0));
    Eigen::Matrix<double, 6, 1> joint_column;
    const Eigen::Vector3d axis = frame.linear().col(2);
    if (robot_.joints[static_cast<std::size_t>(k)].prismatic) {
      joint_column << axis, Eigen::Vector3d::Zero();
    } else {
      joint_column << axis.cross(point - frame.translation()), axis;
    }
    for (int j = 0; j < n; ++j) {
      const double c = robot_.coupling(k, j);
      if (c != 0.0) jacobian.col(layout_.motor(j)) += c * joint_column;
    }
  }
  for (int t = 0; t < layout_.targets; ++t) {
    if (t == target) {
      virtual_joint(tool_reference_, layout_.tool(t, 0));
    } else {
      jacobian.middleCols<6>(layout_.tool(t, 0)).setZero();
    }
  }
  return tool;
}

}  // namespace armtrue
