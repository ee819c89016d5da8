#include "fitter/testing/jacobian_check.h"

#include <gtest/gtest.h>

namespace armtrue::testing {
namespace {

Eigen::VectorXd curve(const Eigen::VectorXd& x) {
  return Eigen::Vector3d(std::sin(x[0]) * x[1], x[0] * x[0] + 1e-3 * x[1], std::exp(x[1]));
}

Eigen::MatrixXd slope(const Eigen::VectorXd& x) {
  Eigen::MatrixXd j(3, 2);
  j << std::cos(x[0]) * x[1], std::sin(x[0]), 2.0 * x[0], 1e-3, 0.0, std::exp(x[1]);
  return j;
}

const Eigen::Vector2d kAt(0.7, -0.4);

TEST(JacobianCheck, AcceptsTheCorrectJacobian) {
  const Eigen::MatrixXd numeric = numeric_jacobian(curve, kAt, Eigen::Vector2d::Ones());
  EXPECT_LT(compare_jacobians(slope(kAt), numeric).worst, 1e-8);
}

TEST(JacobianCheck, DetectsOneEntryWrongByAThousandth) {
  Eigen::MatrixXd wrong = slope(kAt);
  wrong(0, 1) *= 1.001;
  const JacobianDifference found =
      compare_jacobians(wrong, numeric_jacobian(curve, kAt, Eigen::Vector2d::Ones()));
  EXPECT_GT(found.worst, 1e-4);
  EXPECT_EQ(found.row, 0);
  EXPECT_EQ(found.column, 1);
}

TEST(JacobianCheck, DetectsWrongSignSwappedRowsZeroAndNan) {
  const Eigen::MatrixXd right = slope(kAt);
  Eigen::MatrixXd sign = right, swapped = right, zero = right, nan = right;
  sign.col(0) *= -1.0;
  swapped.row(0).swap(swapped.row(1));
  zero(2, 1) = 0.0;
  nan(1, 0) = NAN;
  for (const Eigen::MatrixXd& wrong : {sign, swapped, zero, nan}) {
    EXPECT_GT(compare_jacobians(wrong, right).worst, 1e-3);
  }
}

TEST(JacobianCheck, DetectsAMissingColumn) {
  EXPECT_EQ(compare_jacobians(slope(kAt).leftCols(1), slope(kAt)).worst, INFINITY);
}

TEST(JacobianCheck, ComparesEachColumnRelativeToItsSize) {
  Eigen::MatrixXd right = slope(kAt), wrong;
  right.col(1) *= 1e-4;
  wrong = right;
  wrong(2, 1) *= 1.01;
  EXPECT_GT(compare_jacobians(wrong, right).worst, 5e-3);
}

}  // namespace
}  // namespace armtrue::testing
