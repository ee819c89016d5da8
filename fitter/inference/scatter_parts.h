// Covariance of a solution from readings with unequal or correlated noise.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "fitter/design/normal_equations.h"

namespace armtrue {

/// The residuals of one pose and the directions in which each part of the noise moves them.
struct ScatterColumns {
  /// Equations × random errors: one for each joint and visit, then three (x, y, z) that all
  /// readings of the pose share.
  Eigen::MatrixXd columns;
  std::vector<Eigen::Index> part;  ///< by column: the joint's number, or joints + 1 (pose)
  std::vector<Eigen::Index> own;   ///< by equation: 0 (position) or joints + 2 (orientation)
  Eigen::VectorXd residual;        ///< corrected for leverage
};

/// Variances of the parts of a scatter: of a position's reading, of each joint anew at each visit
/// [rad² or m²], of what a pose's readings share [m²], of a measured orientation. Those of readings
/// are in whitened units. Parts that the data do not show clearly are 0. Minimum norm quadratic
/// estimates (Rao 1971, J. Multivariate Analysis 1, 257), repeated with the weights that they give.
Eigen::VectorXd estimate_scatter(const std::vector<ScatterColumns>& poses, int joints);

/// Covariance of a design's unknowns under noise that is correlated: joints that do not repeat, and
/// errors that the readings of one pose share. `covariance`: under independent noise of `variance`
/// in each equation (sandwich: Huber 1967, Proc. 5th Berkeley Symp. 1, 221; leverage as in
/// MacKinnon and White 1985, J. Econometrics 29, 305); returned unchanged if the data show no such
/// part.
Eigen::MatrixXd with_scatter_in_parts(const Design& design, const EvaluatedRows& evaluated,
                                      const std::vector<PenaltyRow>& penalties,
                                      Eigen::MatrixXd covariance, double variance);

}  // namespace armtrue
