// A fit's model linearised once at its present values, from which all statistics are computed.
#pragma once

#include <Eigen/Core>
#include <array>
#include <vector>

#include "fitter/model/poses.h"
#include "fitter/solve/fit.h"

namespace armtrue {

/// Residual and Jacobian of all rows of a fit, whitened by the instrument's covariance. Rows that
/// the fit rejected as gross errors have a bounded weight instead of none, since they may show a
/// local effect that the model lacks. Equations are ordered by row of the file, `height` for each.
struct Linearization {
  int height = 3;  ///< equations a row: 3, or 6 with orientations
  Poses poses;
  CoordinateLayout layout;
  Eigen::VectorXd residual;     ///< predicted − measured
  std::vector<int> unknown;     ///< unknown of the design, by column of `jacobian`
  Eigen::MatrixXd jacobian;     ///< equations × unknowns, without nodes of joint tables
  std::vector<int> node;        ///< unknown of the design, by column of `nodes`
  Eigen::MatrixXd nodes;        ///< Jacobian of nodes of joint tables; empty if these are many
  Eigen::VectorXd from_tables;  ///< contribution of the fit's joint tables to the prediction
  /// Change of `residual` if loads acted at the commanded angles instead of those of the deflected
  /// arm, or the reverse (Fit::choose_where_loads_act). Empty if no term reads loads.
  Eigen::VectorXd by_other_loads;
  Eigen::MatrixXd geometry;                  ///< equations × coordinates
  Eigen::MatrixXd translation;               ///< equations × 3: a shift of the measured point
  std::array<std::vector<double>, 3> point;  ///< predicted, by axis and row, in the measuring frame
  std::vector<bool> prismatic;               ///< by joint
  double typical_sigma = 1.0;                ///< [m] of one whitened unit of position
  double sigma_rotation = 0.0;  ///< [rad] of one whitened unit of orientation; 0: none measured
  std::vector<bool> rotation_is_copied;  ///< by row, as in Measurements
  double counted = 1.0;                  ///< equations, as equations_that_count counts them
  double freedom = 1.0;                  ///< `counted` less the fit's effective unknowns

  Eigen::Index equations() const { return residual.size(); }
  std::size_t rows() const { return poses.pose_of_row.size(); }
  /// Displacement of the tool by one unit of a whitened column, root mean square over rows [m].
  double displacement(const Eigen::Ref<const Eigen::VectorXd>& column) const;
};

Linearization linearize(Fit& fit);

}  // namespace armtrue
