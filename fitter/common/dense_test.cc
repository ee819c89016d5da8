#include "fitter/common/dense.h"

#include <gtest/gtest.h>

#include <Eigen/LU>
#include <random>

#include "fitter/design/normal_equations.h"

namespace armtrue {
namespace {

Eigen::MatrixXd some_matrix(Eigen::Index rows, Eigen::Index columns) {
  Eigen::MatrixXd m(rows, columns);
  for (Eigen::Index c = 0; c < columns; ++c) {
    for (Eigen::Index r = 0; r < rows; ++r) {
      m(r, c) = std::sin(1.0 + 7.0 * static_cast<double>(r) + 0.37 * static_cast<double>(c * c));
    }
  }
  return m;
}

Eigen::MatrixXd random_matrix(Eigen::Index rows, Eigen::Index columns, unsigned seed) {
  std::mt19937 generator(seed);
  Eigen::MatrixXd m(rows, columns);
  for (double& value : m.reshaped()) value = static_cast<double>(generator()) * 0x1.0p-32 - 0.5;
  return m;
}

class Size : public ::testing::TestWithParam<Eigen::Index> {};
INSTANTIATE_TEST_SUITE_P(Sizes, Size, ::testing::Values(0, 1, 2, 7, 64, 200, 650));

TEST_P(Size, ScaledCholeskySolvesInvertsAndGivesDeterminant) {
  const Eigen::Index n = GetParam();
  const Eigen::MatrixXd half = some_matrix(n + 5, n);
  Eigen::VectorXd units(n);  // spread like metres and radians per newton metre
  for (Eigen::Index i = 0; i < n; ++i) units[i] = std::pow(10.0, static_cast<double>(i % 7) - 3.0);
  Eigen::MatrixXd full = half.transpose() * half + Eigen::MatrixXd::Identity(n, n);
  full = (units.asDiagonal() * full * units.asDiagonal()).eval();
  Eigen::MatrixXd lower = full;
  lower.triangularView<Eigen::StrictlyUpper>().setConstant(1e30);  // must not be read

  const ScaledCholesky factor(lower);
  ASSERT_TRUE(factor.ok());
  const Eigen::MatrixXd identity = Eigen::MatrixXd::Identity(n, n);
  // In units in which all unknowns have the same magnitude.
  const auto error = [&](const Eigen::MatrixXd& inverse) {
    const Eigen::MatrixXd m =
        units.cwiseInverse().asDiagonal() * (full * inverse) * units.asDiagonal();
    return n == 0 ? 0.0 : (m - identity).cwiseAbs().maxCoeff();
  };
  EXPECT_LT(error(factor.inverse()), 1e-9);
  EXPECT_LT(error(factor.solve_matrix(identity)), 1e-9);
  if (n == 0) return;
  const Eigen::VectorXd right = full * Eigen::VectorXd::Ones(n).cwiseQuotient(units);
  EXPECT_LT(
      (factor.solve(right).cwiseProduct(units) - Eigen::VectorXd::Ones(n)).cwiseAbs().maxCoeff(),
      1e-9);
  const Eigen::MatrixXd coordinates = factor.half_solve(identity);
  EXPECT_LT(error(coordinates.transpose() * coordinates), 1e-9);
  double expected = 2.0 * units.array().log().sum();
  const Eigen::MatrixXd even = half.transpose() * half + identity;
  expected += even.partialPivLu().matrixLU().diagonal().array().abs().log().sum();
  EXPECT_NEAR(factor.log_determinant(), expected, 1e-8 * std::max(1.0, std::abs(expected)));
}

TEST_P(Size, CholeskySolves) {
  const Eigen::Index n = GetParam();
  const Eigen::MatrixXd identity = Eigen::MatrixXd::Identity(n, n);
  const Eigen::MatrixXd half = random_matrix(n + 3, n, 7);
  Eigen::MatrixXd lower = half.transpose() * half + identity;
  const Eigen::MatrixXd full = lower;
  lower.triangularView<Eigen::StrictlyUpper>().setConstant(1e30);  // must not be read
  const Cholesky factor(lower);
  ASSERT_TRUE(factor.ok());
  const Eigen::VectorXd wanted = Eigen::VectorXd::LinSpaced(n, 1.0, 2.0);
  EXPECT_TRUE((factor.solve(full * wanted) - wanted).isZero(1e-9));
  EXPECT_TRUE((factor.solve_matrix(full) - identity).isZero(1e-9));
  const Eigen::MatrixXd whitened = factor.half_solve(full);
  EXPECT_TRUE((whitened.transpose() * whitened - full).isZero(1e-8 * (1.0 + full.norm())));
  EXPECT_EQ(Cholesky(-full).ok(), n == 0);
}

TEST_P(Size, LeastSquares_DependentColumns_GivesLeastNorm) {
  const Eigen::Index n = GetParam();
  const Eigen::MatrixXd columns = random_matrix(2 * n, n, 8);
  Eigen::MatrixXd twice(2 * n, 2 * n);
  twice << columns, columns;
  const Eigen::MatrixXd values = random_matrix(2 * n, 2, 9);
  const Eigen::MatrixXd x = least_squares(columns, values);
  EXPECT_TRUE((columns.transpose() * (columns * x - values)).isZero(1e-8));
  const Eigen::MatrixXd shared = least_squares(twice, values);
  ASSERT_EQ(shared.rows(), 2 * n);
  EXPECT_TRUE((shared.topRows(n) - 0.5 * x).isZero(1e-8 * (1.0 + x.norm())));
  EXPECT_TRUE((shared.bottomRows(n) - 0.5 * x).isZero(1e-8 * (1.0 + x.norm())));
}

TEST(Dense, LeastSquares_ColumnBelowLeastShare_GetsZero) {
  const Eigen::Matrix2d columns{{1.0, 0.0}, {0.0, 1e-6}};
  EXPECT_EQ(least_squares(columns, Eigen::Vector2d(1.0, 1e-6), 1e-5),
            Eigen::MatrixXd(Eigen::Vector2d(1.0, 0.0)));
}

TEST_P(Size, GrownFactorEqualsFactorOfTheSum) {
  const Eigen::Index n = GetParam(), more = 40;
  const Eigen::MatrixXd half = some_matrix(n + 5, n), part = some_matrix(n, more);
  Eigen::MatrixXd root = half.transpose() * half + Eigen::MatrixXd::Identity(n, n);
  ASSERT_TRUE(factorise_cholesky(root));
  const Eigen::MatrixXd lower = root.triangularView<Eigen::Lower>();
  root.triangularView<Eigen::StrictlyUpper>().setConstant(1e30);  // must not be read

  const GrownFactor grown(root, part);
  const Eigen::MatrixXd expected = lower * lower.transpose() + part * part.transpose();
  if (n == 0) return;
  EXPECT_GT(grown.factor().diagonal().minCoeff(), 0.0);
  EXPECT_EQ(Eigen::MatrixXd(grown.factor().triangularView<Eigen::StrictlyUpper>()).norm(), 0.0);
  EXPECT_LT((grown.factor() * grown.factor().transpose() - expected).norm(),
            1e-12 * expected.norm());
  const Eigen::MatrixXd a = some_matrix(n, 300), b = some_matrix(more, 300);
  Eigen::MatrixXd turned = a, used = b;
  grown.turn(turned, used);
  EXPECT_LT((grown.factor() * turned - (lower * a + part * b)).norm(), 1e-11 * expected.norm());
}

TEST_P(Size, SymmetricEigenRecoversAKnownSpectrum) {
  const Eigen::Index n = GetParam();
  // A Householder reflection does not change the eigenvalues of diag(1 … n).
  Eigen::VectorXd known(n), v = Eigen::VectorXd::LinSpaced(n, 1.0, 2.0);
  for (Eigen::Index i = 0; i < n; ++i) known[i] = static_cast<double>(i + 1);
  if (n > 0) v.normalize();
  const Eigen::MatrixXd turn = Eigen::MatrixXd::Identity(n, n) - 2.0 * v * v.transpose();
  Eigen::MatrixXd lower = turn * known.asDiagonal() * turn;
  lower.triangularView<Eigen::StrictlyUpper>().setConstant(1e30);  // must not be read
  const Eigen::VectorXd found = symmetric_eigenvalues(lower);
  ASSERT_EQ(found.size(), n);
  EXPECT_LT((found - known).lpNorm<Eigen::Infinity>(), 1e-10);
  const SymmetricEigen both = symmetric_eigen(lower);
  if (n == 0) return;
  EXPECT_LT((both.values - known).lpNorm<Eigen::Infinity>(), 1e-10);
  const Eigen::MatrixXd again = both.vectors * both.values.asDiagonal() * both.vectors.transpose();
  EXPECT_LT((again - turn * known.asDiagonal() * turn).lpNorm<Eigen::Infinity>(), 1e-9);
}

TEST(SymmetricEigenOfTwo, EigenpairsSolveEveryTestedMatrix) {
  for (const double first : {0.0, 1.0, -2.0, 1e-9, 3e7}) {
    for (const double second : {0.0, 1.0, -3.0, 2e7}) {
      for (const double beside : {0.0, 1e-12, 0.5, -4.0, 1e7}) {
        Eigen::Matrix2d m;
        m << first, beside, beside, second;
        const SymmetricEigen found = symmetric_eigen(m);
        const double size = m.cwiseAbs().maxCoeff();
        EXPECT_LE(found.values[0], found.values[1]);
        EXPECT_LE((m * found.vectors - found.vectors * found.values.asDiagonal())
                      .lpNorm<Eigen::Infinity>(),
                  1e-15 * size)
            << m;
        EXPECT_LT((found.vectors.transpose() * found.vectors - Eigen::Matrix2d::Identity())
                      .lpNorm<Eigen::Infinity>(),
                  1e-15);
      }
    }
  }
}

TEST_P(Size, SquaresAndTriangularSolves_AcceptMatrixBlocks) {
  const Eigen::Index n = GetParam();
  const Eigen::MatrixXd whole = some_matrix(n + 3, n + 2);
  const auto part = whole.block(1, 1, n, n);
  const auto largest = [](const Eigen::MatrixXd& m) {
    return m.size() > 0 ? m.cwiseAbs().maxCoeff() : 0.0;
  };
  EXPECT_LT(largest(square(part) - part.transpose() * part), 1e-12 * static_cast<double>(n + 1));
  EXPECT_LT(largest(square_across(part) - part * part.transpose()),
            1e-12 * static_cast<double>(n + 1));
  Eigen::MatrixXd factor = Eigen::MatrixXd::Constant(n, n, 1e30);  // upper part must not be read
  factor.triangularView<Eigen::Lower>() =
      Eigen::MatrixXd(0.1 * part + 3.0 * Eigen::MatrixXd::Identity(n, n));
  const Eigen::MatrixXd lower = factor.triangularView<Eigen::Lower>();
  Eigen::MatrixXd right = some_matrix(n + 2, 3);
  const Eigen::MatrixXd before = right.middleRows(1, n);
  solve_lower(factor, right.middleRows(1, n));
  EXPECT_LT(largest(lower * right.middleRows(1, n) - before), 1e-9);
  right.middleRows(1, n) = before;
  solve_lower_transposed(factor, right.middleRows(1, n));
  EXPECT_LT(largest(lower.transpose() * right.middleRows(1, n) - before), 1e-9);
}

TEST(ScaledCholesky, IndefiniteMatrix_IsNotOk) {
  Eigen::MatrixXd m = Eigen::MatrixXd::Identity(3, 3);
  m(2, 0) = 2.0;
  EXPECT_FALSE(ScaledCholesky(m).ok());
}

TEST_P(Size, TransposeTimesAcceptsMatrixBlocks) {
  const Eigen::Index n = GetParam();
  const Eigen::MatrixXd a = some_matrix(n + 3, n + 2), b = some_matrix(n + 3, 4);
  const auto left = a.block(1, 1, n, n);
  const auto right = b.block(2, 1, n, 2);
  const Eigen::MatrixXd expected = left.transpose().lazyProduct(right);
  const Eigen::MatrixXd product = transpose_times(left, right);
  ASSERT_EQ(product.rows(), n);
  ASSERT_EQ(product.cols(), 2);
  EXPECT_LE((product - expected).norm(), 1e-12 * (1.0 + expected.norm()));
}

// With at most eight columns on the left, the product takes another code path. Both matrices are
// blocks of larger ones, as in the callers.
TEST(Dense, TransposeTimes_FewLeftColumns_GivesTheProduct) {
  const Eigen::MatrixXd from = random_matrix(410, 5, 21), wide = random_matrix(420, 333, 22);
  const auto left = from.middleRows(3, 400);
  const auto right = wide.middleRows(7, 400);
  const Eigen::MatrixXd expected = left.transpose().lazyProduct(right);
  EXPECT_LE((transpose_times(left, right) - expected).norm(), 1e-12 * expected.norm());
}

// Most columns are mostly zero, like those of a table's nodes; some are entirely zero.
TEST(Dense, SquareOfSparseColumnsGivesTheProduct) {
  Eigen::MatrixXd a = random_matrix(4000, 800, 23);
  for (Eigen::Index c = 0; c < a.cols(); ++c) {
    if (c % 8 < 3) continue;
    for (Eigen::Index r = 0; r < a.rows(); ++r) {
      if (c % 8 == 3 || (r / 3 + c) % 40 != 0) a(r, c) = 0.0;
    }
  }
  const Eigen::MatrixXd expected = transpose_times(a, a);
  EXPECT_LE((square(a) - expected).norm(), 1e-13 * expected.norm());
}

}  // namespace
}  // namespace armtrue
