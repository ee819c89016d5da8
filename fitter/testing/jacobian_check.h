// Compares two Jacobians entry by entry and gives the place of their largest difference. Tested in
// jacobian_check_test.cc.
#pragma once

#include <Eigen/Core>
#include <cmath>
#include <functional>
#include <string>

namespace armtrue::testing {

struct JacobianDifference {
  double worst =
      0.0;  ///< largest |a − b| over the size of its column (at least 1e-6 of the largest entry)
  Eigen::Index row = 0, column = 0;

  std::string text() const {
    return "worst relative difference " + std::to_string(worst) + " at row " + std::to_string(row) +
           ", column " + std::to_string(column);
  }
};

inline JacobianDifference compare_jacobians(const Eigen::MatrixXd& a, const Eigen::MatrixXd& b) {
  JacobianDifference result;
  if (a.rows() != b.rows() || a.cols() != b.cols()) return {INFINITY, 0, 0};
  const double floor = std::max(1e-300, 1e-6 * b.cwiseAbs().maxCoeff());
  for (Eigen::Index c = 0; c < a.cols(); ++c) {
    const double size = std::max(floor, b.col(c).cwiseAbs().maxCoeff());
    for (Eigen::Index r = 0; r < a.rows(); ++r) {
      const double difference = std::abs(a(r, c) - b(r, c)) / size;
      if (!(difference <= result.worst)) {
        result = {std::isnan(difference) ? INFINITY : difference, r, c};
      }
    }
  }
  return result;
}

/// Central differences of f at x, with a step of `relative` times each unknown's own size.
inline Eigen::MatrixXd numeric_jacobian(
    const std::function<Eigen::VectorXd(const Eigen::VectorXd&)>& f, const Eigen::VectorXd& x,
    const Eigen::VectorXd& size, double relative = 1e-5) {
  const Eigen::Index height = f(x).size();
  Eigen::MatrixXd jacobian(height, x.size());
  for (Eigen::Index c = 0; c < x.size(); ++c) {
    const double step = relative * size[c];
    Eigen::VectorXd above = x, below = x;
    above[c] += step;
    below[c] -= step;
    jacobian.col(c) = (f(above) - f(below)) / (above[c] - below[c]);
  }
  return jacobian;
}

}  // namespace armtrue::testing
