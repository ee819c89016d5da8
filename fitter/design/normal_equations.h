// Linearised least squares at a design's present values: what identifiability, covariance,
// cross-validation and the diagnosis need.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "fitter/common/dense.h"
#include "fitter/design/design.h"

namespace armtrue {

/// A row of quadratic penalty added to the measurements: prior, gauge or smoothness.
struct PenaltyRow {
  std::vector<std::pair<int, double>> entries;  ///< unknown, factor / sigma
  double target = 0.0;                          ///< / sigma

  /// Residual of the row at `values` of the unknowns.
  double residual(const std::vector<double>& values) const;
};

/// Priors of the free parameters and penalties of the model, in unknowns. `smoothness_sigma` scales
/// smoothness rows.
std::vector<PenaltyRow> penalty_rows(const Design& design, double smoothness_sigma);

/// Number of equations that determine the residuals' variance: per row three for positions, and for
/// orientations three times the ratio of their Σ r² to that of positions, at most three. A fit can
/// give orientations a smaller weight than their noise alone would (inference/orientation_worth.h);
/// counted in full, these small residuals would make the variance seem smaller than it is.
/// `squares`, `position_squares`: Σ r² over `rows` of all residuals, and of positions.
double equations_that_count(double rows, double squares, double position_squares);

/// JᵀJ and Jᵀr of the measurements, in unknowns.
struct NormalEquations {
  Eigen::MatrixXd information;  ///< JᵀJ, lower triangle filled
  Eigen::VectorXd gradient;     ///< Jᵀr
  double cost = 0.0;            ///< Σ r²
  double position_cost = 0.0;   ///< the part of positions
  std::size_t rows = 0;         ///< with weight

  explicit NormalEquations(Eigen::Index unknowns)
      : information(Eigen::MatrixXd::Zero(unknowns, unknowns)),
        gradient(Eigen::VectorXd::Zero(unknowns)) {}
  double equations() const {
    return equations_that_count(static_cast<double>(rows), cost, position_cost);
  }
  /// On all processors; the sums do not depend on their number.
  void add(const std::vector<const Design::Row*>& added, int residuals);
  void add(const PenaltyRow& row, const std::vector<double>& values);
};

/// The rows with weight of a design, evaluated with their Jacobian at its present values.
struct EvaluatedRows {
  std::vector<std::size_t> index;  ///< row of the design
  std::vector<Design::Row> rows;
  /// By row, equations × joints: whitened change of the measured pose per unit of each joint's
  /// motor.
  std::vector<Eigen::Matrix<double, 6, Eigen::Dynamic>> by_joint;
};
EvaluatedRows evaluate_rows(const Design& design);

NormalEquations accumulate(const Design& design, const EvaluatedRows& evaluated);
/// Over all rows of a design at its present values.
NormalEquations accumulate(const Design& design);
/// NormalEquations::gradient alone.
Eigen::VectorXd gradient_of(const Design& design);
/// NormalEquations::cost alone.
double squared_residuals(const Design& design);

/// Scaled Cholesky factor of a symmetric positive matrix, given its lower triangle.
class ScaledCholesky {
 public:
  explicit ScaledCholesky(Eigen::MatrixXd lower);
  bool ok() const { return factor_.ok(); }
  Eigen::VectorXd solve(const Eigen::VectorXd& right) const;
  Eigen::MatrixXd solve_matrix(const Eigen::MatrixXd& right) const;
  Eigen::MatrixXd inverse() const;
  /// The lower triangle W whose square WᵀW is the inverse; entries above its diagonal are
  /// undefined.
  Eigen::MatrixXd inverse_root() const;
  /// L⁻¹ D with D the scaling: columns of a matrix become orthonormal coordinates of the solution
  /// space.
  Eigen::MatrixXd half_solve(const Eigen::MatrixXd& right) const;
  double log_determinant() const;

 private:
  Eigen::VectorXd scale_;
  Cholesky factor_;
};

}  // namespace armtrue
