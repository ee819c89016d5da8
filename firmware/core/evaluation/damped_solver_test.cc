#include "firmware/core/evaluation/damped_solver.h"

#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>
#include <random>

namespace armtrue {
namespace {

constexpr double kDamping = 0.02;

struct Problem {
  Jacobian jacobian = {};
  Eigen::MatrixXd exact;
  std::size_t rows;
  std::size_t joints;
};

Problem problem_of(const Eigen::MatrixXd& matrix) {
  Problem problem;
  problem.exact = matrix;
  problem.rows = static_cast<std::size_t>(matrix.rows());
  problem.joints = static_cast<std::size_t>(matrix.cols());
  for (std::size_t k = 0; k < problem.joints; ++k) {
    for (std::size_t i = 0; i < problem.rows; ++i) {
      problem.jacobian[k][i] = static_cast<std::int32_t>(std::lround(
          std::ldexp(matrix(static_cast<int>(i), static_cast<int>(k)), kJacobianFraction)));
    }
  }
  return problem;
}

ToolError error_of(const Eigen::VectorXd& error) {
  ToolError result = {};
  for (int i = 0; i < error.size(); ++i) {
    result[static_cast<std::size_t>(i)].raw =
        static_cast<std::int32_t>(std::lround(std::ldexp(error[i], Coordinate::fraction)));
  }
  return result;
}

Eigen::VectorXd solved(const Problem& problem, const Eigen::VectorXd& error,
                       bool* singular = nullptr) {
  DampedSolver solver;
  solver.factor(problem.jacobian, problem.joints, problem.rows,
                {static_cast<std::int32_t>(std::lround(std::ldexp(kDamping, Length::fraction)))});
  if (singular != nullptr) *singular = solver.is_near_singular();
  const JointStep step = solver.step(error_of(error));
  Eigen::VectorXd result(static_cast<int>(problem.joints));
  for (std::size_t k = 0; k < problem.joints; ++k) {
    result[static_cast<int>(k)] = std::ldexp(step[k].raw, -Coordinate::fraction);
  }
  return result;
}

// J Jᵀ = U S² Uᵀ gives all that the tests need of J, and compiles much faster than a singular value
// decomposition.
struct Singular {
  Eigen::MatrixXd vectors;  // U
  Eigen::VectorXd values;   // S

  explicit Singular(const Eigen::MatrixXd& j) {
    const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> square(j * j.transpose());
    vectors = square.eigenvectors();
    values = square.eigenvalues().cwiseMax(0.0).cwiseSqrt();
  }
};

Eigen::VectorXd exact_step(const Eigen::MatrixXd& j, const Eigen::VectorXd& e) {
  const Singular singular(j);
  const Eigen::VectorXd damped = singular.values.array().square() + kDamping * kDamping;
  const Eigen::VectorXd turned = singular.vectors.transpose() * e;
  return j.transpose() * (singular.vectors * turned.cwiseQuotient(damped));
}

class DampedSolverTest : public ::testing::TestWithParam<int> {};

TEST_P(DampedSolverTest, AgreesWithDoublePrecision) {
  std::mt19937 random(1);
  std::normal_distribution<double> normal;
  const int rows = GetParam();
  for (int i = 0; i < 2000; ++i) {
    const Eigen::MatrixXd j =
        Eigen::MatrixXd::NullaryExpr(rows, 6 + i % 3, [&] { return 0.8 * normal(random); });
    const double size = std::pow(10.0, -2.0 - 5.0 * (i % 7) / 6.0);
    const Eigen::VectorXd e =
        Eigen::VectorXd::NullaryExpr(rows, [&] { return size * normal(random); });
    const Eigen::VectorXd wanted = exact_step(j, e);
    const Eigen::VectorXd found = solved(problem_of(j), e);
    const Eigen::VectorXd values = Singular(j).values;
    // y has 14 fraction bits for an error of about 1, the matrix 30 bits for its largest element;
    // the step itself has 30.
    const double of_solution = std::ldexp(values.maxCoeff() * e.norm(), -12);
    const double of_matrix = std::ldexp(1.0, -27) * values.squaredNorm() /
                             (std::pow(values.minCoeff(), 2) + kDamping * kDamping) * wanted.norm();
    // The effect of rounding the inputs: the error (2^-31) and the Jacobian (2^-23).
    const double gain = values.minCoeff() / (std::pow(values.minCoeff(), 2) + kDamping * kDamping);
    const double of_input =
        3.0 * gain * (std::ldexp(1.0, -31) + std::ldexp(2.0, -23) * wanted.norm());
    EXPECT_LT((found - wanted).norm(), of_solution + of_matrix + of_input + 4e-9) << i;
  }
}

TEST_P(DampedSolverTest, StepsStayWithinTheStatedBoundAtSingularities) {
  std::mt19937 random(2);
  std::normal_distribution<double> normal;
  const int rows = GetParam();
  for (int i = 0; i < 2000; ++i) {
    Eigen::MatrixXd j = Eigen::MatrixXd::NullaryExpr(rows, 6, [&] { return normal(random); });
    const Singular singular(j);
    Eigen::VectorXd scale = Eigen::VectorXd::Ones(rows);
    // The smallest singular value varies from 0, the singularity, to 4 λ.
    scale[0] = (i % 20) * 0.004 / singular.values[0];
    const Eigen::MatrixXd rows_of_v = singular.vectors.transpose() * j;  // S Vᵀ
    j = singular.vectors * (scale.asDiagonal() * rows_of_v);
    const Eigen::VectorXd e =
        Eigen::VectorXd::NullaryExpr(rows, [&] { return 1e-3 * normal(random); });
    bool is_near = false;
    const Eigen::VectorXd step = solved(problem_of(j), e, &is_near);
    EXPECT_LE(step.norm(), 1.01 * e.norm() / (2.0 * kDamping) + 1e-8) << i;
    EXPECT_TRUE(is_near) << i;
  }
}

TEST_P(DampedSolverTest, RegularPosturesAreNotFlagged) {
  std::mt19937 random(3);
  std::normal_distribution<double> normal;
  const int rows = GetParam();
  for (int i = 0; i < 500; ++i) {
    const Eigen::MatrixXd j = Eigen::MatrixXd::NullaryExpr(rows, 6, [&] { return normal(random); });
    if (Singular(j).values.minCoeff() < 15.0 * kDamping) continue;
    bool is_near = true;
    solved(problem_of(j), Eigen::VectorXd::Constant(rows, 1e-3), &is_near);
    EXPECT_FALSE(is_near) << i;
  }
}

INSTANTIATE_TEST_SUITE_P(Rows, DampedSolverTest, ::testing::Values(3, 6));

TEST(DampedSolverTest, ZeroJacobian_AtLeastDamping_GivesNoStep) {
  // All axes pass through the tool: J is zero and only λ² is left, 2^28 in the solver's format.
  const Jacobian jacobian = {};
  DampedSolver solver;
  solver.factor(jacobian, 6, 3, {std::int32_t{1} << (Length::fraction - 8)});
  EXPECT_TRUE(solver.is_near_singular());
  const JointStep step = solver.step({{{1 << 20}, {-(1 << 20)}, {5}, {0}, {0}, {0}}});
  for (std::size_t k = 0; k < 6; ++k) EXPECT_EQ(step[k].raw, 0);
}

TEST(DampedSolverTest, ArmsOf11To17Millimetres_AgreeWithDoublePrecision) {
  // Their squares, 2^31 to 2^32 in the solver's format, are scaled to 30 bits like larger ones.
  for (const double arm : {0.0112, 0.0125, 0.0145, 0.0155, 0.0165}) {
    Jacobian jacobian = {};
    for (std::size_t k = 0; k < 3; ++k) {
      jacobian[k][k] = static_cast<std::int32_t>(std::lround(std::ldexp(arm, kJacobianFraction)));
    }
    const double damping = std::ldexp(1.0, -8);
    DampedSolver solver;
    solver.factor(jacobian, 3, 3, {std::int32_t{1} << (Length::fraction - 8)});
    const double error = 1e-4;
    const JointStep step = solver.step(error_of(Eigen::VectorXd::Constant(3, error)));
    const double wanted = arm * error / (arm * arm + damping * damping);
    for (std::size_t k = 0; k < 3; ++k) {
      EXPECT_NEAR(std::ldexp(step[k].raw, -Coordinate::fraction), wanted, 1e-3 * wanted) << arm;
    }
  }
}

TEST(DampedSolverTest, LargestElements_GiveNoStepTheWrongWay) {
  // The largest elements that couplings permit (checks_arm.cc): λ² is negligible beside them.
  Jacobian jacobian = {};
  for (JacobianColumn& column : jacobian) column[0] = std::int32_t{1} << 29;
  DampedSolver solver;
  solver.factor(jacobian, kMaxJoints, 3, {std::int32_t{1} << (Length::fraction - 8)});
  EXPECT_TRUE(solver.is_near_singular());
  // The step is too small for the solver's format: it may be zero, but not in the wrong direction.
  const JointStep step = solver.step({{{1 << 27}, {0}, {0}, {0}, {0}, {0}}});
  for (const Coordinate& each : step) {
    EXPECT_GE(each.raw, 0);
    EXPECT_LE(each.raw, (1 << 27) / 1024);
  }
}

}  // namespace
}  // namespace armtrue
