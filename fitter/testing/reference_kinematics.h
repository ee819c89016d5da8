// A second implementation of the unified model, for any scalar type: Ceres' automatic
// differentiation of it checks the analytic Jacobians. Shares no formula with
// fitter/model/kinematics.cc: 4x4 products, Rodrigues from Ceres.
#pragma once

#include <ceres/jet.h>
#include <ceres/rotation.h>

#include <Eigen/Core>
#include <functional>
#include <string>
#include <vector>

#include "fitter/model/coordinate.h"
#include "fitter/model/expression/expression.h"
#include "fitter/model/robot.h"

namespace armtrue::testing {

template <typename T>
using Matrix4 = Eigen::Matrix<T, 4, 4>;

/// Homogeneous matrix of Trans(v0..2) · exp([v3..5]×).
template <typename T>
Matrix4<T> virtual_joint(const T* v) {
  Matrix4<T> m = Matrix4<T>::Identity();
  T column_major[9];
  ceres::AngleAxisToRotationMatrix(v + 3, column_major);
  for (int c = 0; c < 3; ++c) {
    for (int r = 0; r < 3; ++r) m(r, c) = column_major[3 * c + r];
    m(c, 3) = v[c];
  }
  return m;
}

/// measuring_from_tool of docs/model.md, section "Chain", for motor-side joints and coordinates of
/// any scalar.
template <typename T>
Matrix4<T> reference_pose(const Robot& robot, const Pose& measuring_from_base,
                          const Pose& flange_from_tool, const CoordinateLayout& layout,
                          const double* q, const std::vector<T>& coordinates, int target) {
  using std::cos;
  using std::sin;
  const int n = robot.joint_count();
  Matrix4<T> m = measuring_from_base.matrix().cast<T>();
  m = m * virtual_joint(&coordinates[static_cast<std::size_t>(layout.base(0))]);
  for (int k = 0; k < n; ++k) {
    const Joint& joint = robot.joints[static_cast<std::size_t>(k)];
    T variable(joint.offset);
    for (int j = 0; j < n; ++j) {
      variable += robot.coupling(k, j) * (q[j] + coordinates[static_cast<std::size_t>(j)]);
    }
    Matrix4<T> move = Matrix4<T>::Identity();
    if (joint.prismatic) {
      move(2, 3) = variable;
    } else {
      move(0, 0) = move(1, 1) = cos(variable);
      move(1, 0) = sin(variable);
      move(0, 1) = -move(1, 0);
    }
    m = m * joint.fixed.matrix().cast<T>() * move *
        virtual_joint(&coordinates[static_cast<std::size_t>(layout.link(k, 0))]);
  }
  return m * robot.end.matrix().cast<T>() * flange_from_tool.matrix().cast<T>() *
         virtual_joint(&coordinates[static_cast<std::size_t>(layout.tool(target, 0))]);
}

/// Value of an expression for any scalar; functions with kinks use comparisons.
template <typename T>
T reference_value(const Expression& e, const std::function<T(const std::string&)>& lookup) {
  using Op = Expression::Op;
  using std::abs;
  using std::acos;
  using std::asin;
  using std::atan;
  using std::atan2;
  using std::cos;
  using std::exp;
  using std::log;
  using std::pow;
  using std::sin;
  using std::sqrt;
  using std::tan;
  using std::tanh;
  if (e.op() == Op::kNumber) return T(e.value());
  if (e.op() == Op::kVariable) return lookup(e.name());
  std::vector<T> a;
  for (const Expression& argument : e.arguments())
    a.push_back(reference_value<T>(argument, lookup));
  switch (e.op()) {
    case Op::kAdd:
      return a[0] + a[1];
    case Op::kSubtract:
      return a[0] - a[1];
    case Op::kMultiply:
      return a[0] * a[1];
    case Op::kDivide:
      return a[0] / a[1];
    case Op::kPower:
      if (e.arguments()[1].is_constant()) return pow(a[0], e.arguments()[1].value());
      return pow(a[0], a[1]);
    case Op::kNegate:
      return -a[0];
    case Op::kSin:
      return sin(a[0]);
    case Op::kCos:
      return cos(a[0]);
    case Op::kTan:
      return tan(a[0]);
    case Op::kAsin:
      return asin(a[0]);
    case Op::kAcos:
      return acos(a[0]);
    case Op::kAtan:
      return atan(a[0]);
    case Op::kExp:
      return exp(a[0]);
    case Op::kLog:
      return log(a[0]);
    case Op::kSqrt:
      return sqrt(a[0]);
    case Op::kAbs:
      return abs(a[0]);
    case Op::kSign:
      return a[0] > T(0.0) ? T(1.0) : (a[0] < T(0.0) ? T(-1.0) : T(0.0));
    case Op::kTanh:
      return tanh(a[0]);
    case Op::kAtan2:
      return atan2(a[0], a[1]);
    case Op::kMin:
      return a[0] < a[1] ? a[0] : a[1];
    case Op::kMax:
      return a[0] < a[1] ? a[1] : a[0];
    case Op::kHat:
      if (a[0] <= a[2]) {
        if (a[1] >= a[2]) return T(1.0);
        return a[0] <= a[1] ? T(0.0) : (a[0] - a[1]) / (a[2] - a[1]);
      }
      if (a[3] <= a[2]) return T(1.0);
      return a[0] >= a[3] ? T(0.0) : (a[3] - a[0]) / (a[3] - a[2]);
    default:
      break;
  }
  throw std::logic_error("no reference for this operation");
}

}  // namespace armtrue::testing
