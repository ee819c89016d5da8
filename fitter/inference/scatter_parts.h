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
  std::vector<Eigen::Index> part;  ///< variance by column: the joint's number, or joints + 1 (pose)
  std::vector<Eigen::Index> own;   ///< by equation: 0 (position) or joints + 2 (orientation)
  Eigen::VectorXd residual;        ///< corrected for leverage
};

/// Variances of the parts of the scatter, in this order: of a position reading, of each joint from
/// visit to visit [rad² or m²], of the error that all readings of a pose share [m²], of an
/// orientation reading. Those of readings are in whitened units. Joint and pose parts that are not
/// significant are 0. Minimum norm quadratic estimates (Rao 1971, J. Multivariate Analysis 1, 257),
/// repeated with the weights of the previous estimate.
Eigen::VectorXd estimate_scatter(const std::vector<ScatterColumns>& poses, int joints);

/// Covariance of a design's unknowns under correlated noise: joints that do not repeat exactly, and
/// errors that the readings of one pose share (sandwich: Huber 1967, Proc. 5th Berkeley Symp. 1,
/// 221; leverage as in MacKinnon and White 1985, J. Econometrics 29, 305). `covariance`: the same
/// under independent noise of `variance` in each equation; returned unchanged if no joint or pose
/// part is significant.
Eigen::MatrixXd with_scatter_in_parts(const Design& design, const EvaluatedRows& evaluated,
                                      const std::vector<PenaltyRow>& penalties,
                                      Eigen::MatrixXd covariance, double variance);

}  // namespace armtrue
