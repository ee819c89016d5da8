// The covariance of a solution where readings do not scatter alike, or not independently.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "fitter/design/normal_equations.h"

namespace armtrue {

/// What one part of the scatter is in each equation of a pose's readings.
struct ScatterColumns {
  Eigen::MatrixXd columns;         ///< equations × visits of every joint, and three of the pose
  std::vector<Eigen::Index> part;  ///< of each column: 1 … joints, or joints + 1 for the pose
  std::vector<Eigen::Index> own;   ///< by equation: part 0 for a position, joints + 2 for a turn
  Eigen::VectorXd residual;        ///< as large as if no unknown had followed it
};

/// Variances of the parts of a scatter: of a position's reading, of each joint anew at each visit
/// [rad² or m²], of what a pose's readings share [m²], of a measured orientation. Those of readings
/// are in whitened units. Parts that the data do not show clearly are 0. Minimum norm quadratic
/// estimates (Rao 1971, J. Multivariate Analysis 1, 257), repeated with the weights that they give.
Eigen::VectorXd estimate_scatter(const std::vector<ScatterColumns>& poses, int joints);

/// `covariance` of a design's unknowns takes all equations to scatter by `variance`, each for
/// itself. The result holds where a joint does not come back to where it was, and where readings of
/// one pose share an error (sandwich: Huber 1967, Proc. 5th Berkeley Symp. 1, 221; leverage as in
/// MacKinnon and White 1985, J. Econometrics 29, 305). The same where data show no such part.
Eigen::MatrixXd with_scatter_in_parts(const Design& design, const EvaluatedRows& evaluated,
                                      const std::vector<PenaltyRow>& penalties,
                                      Eigen::MatrixXd covariance, double variance);

}  // namespace armtrue
