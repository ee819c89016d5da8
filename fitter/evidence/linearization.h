// A fit's model linearised once at its present values: what every statistic is a function of.
#pragma once

#include <Eigen/Core>
#include <array>
#include <vector>

#include "fitter/model/poses.h"
#include "fitter/solve/fit.h"

namespace armtrue {

/// Residual and Jacobian of a fit, whitened by the instrument's own covariance, all rows: those
/// kept out of the fit as gross errors have a bounded weight, since what looks like a bump may be a
/// local effect that no term names yet. Equations stand row by row of the file, `height` each.
struct Linearization {
  int height = 3;  ///< equations a row: 3, or 6 with orientations
  Poses poses;
  CoordinateLayout layout;
  Eigen::VectorXd residual;     ///< predicted − measured
  std::vector<int> unknown;     ///< unknown of the design that each column of `jacobian` is
  Eigen::MatrixXd jacobian;     ///< equations × unknowns that are no nodes of joint tables
  std::vector<int> node;        ///< unknown of each column of `nodes`
  Eigen::MatrixXd nodes;        ///< the same for nodes of joint tables; none where they are many
  Eigen::VectorXd from_tables;  ///< what joint tables of the fit add to the prediction
  /// By what `residual` would change if loads acted at commanded angles in place of where the arm
  /// stands, or the other way round (Fit::choose_where_loads_act). Empty where nothing reads loads.
  Eigen::VectorXd by_other_loads;
  Eigen::MatrixXd geometry;                  ///< equations × coordinates
  Eigen::MatrixXd translation;               ///< equations × 3: a shift of the measured point
  std::array<std::vector<double>, 3> point;  ///< predicted, by axis and row, in the measuring frame
  std::vector<bool> prismatic;               ///< by joint
  double typical_sigma = 1.0;                ///< [m] of one whitened unit of position
  double sigma_rotation = 0.0;  ///< [rad] of one whitened unit of orientation; 0: none measured
  double counted = 1.0;         ///< equations, as equations_that_count counts them
  double freedom = 1.0;         ///< of these, less the fit's effective unknowns

  Eigen::Index equations() const { return residual.size(); }
  std::size_t rows() const { return poses.pose_of_row.size(); }
  /// Root mean square over rows of the displacement of the tool by one unit of a whitened column
  /// [m].
  double displacement(const Eigen::Ref<const Eigen::VectorXd>& column) const;
};

Linearization linearize(Fit& fit);

}  // namespace armtrue
