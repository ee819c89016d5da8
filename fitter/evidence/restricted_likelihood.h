// Restricted likelihood of a residual under NoiseParts, independent of the model's coefficients,
// with its derivatives by each variance.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <vector>

#include "fitter/evidence/linearization.h"
#include "fitter/evidence/noise.h"

namespace armtrue {

/// The first equations of a row are of the position, those after them of the orientation.
inline constexpr int kPositionEquations = 3;

/// Columns of every part of the noise in the equations of one pose.
struct PoseParts {
  std::vector<Eigen::Index> equations;
  std::vector<bool> turns;             ///< by equation: belongs to an orientation
  std::vector<Eigen::MatrixXd> joint;  ///< by joint: equations × visits
  Eigen::MatrixXd shared;              ///< equations × 3
};

/// The parts of every `stride`-th pose.
std::vector<PoseParts> parts_of_poses(const Linearization& linearization, std::size_t stride = 1);

/// L⁻¹ of a pose's covariance LLᵀ.
Eigen::MatrixXd inverse_root_of(const PoseParts& pose, const NoiseParts& parts);

/// Variances in the order of Score: the reading, each joint, the part that a pose's readings share,
/// the orientation.
Eigen::VectorXd variances_of(const NoiseParts& parts);

/// The logarithm of the restricted likelihood, its slope by the variances, and their Fisher
/// information (Patterson and Thompson 1971, Biometrika 58, 545).
struct Score {
  double value = 0.0;
  Eigen::VectorXd slope;
  Eigen::MatrixXd information;
};

/// Uses only as many poses as determine the variances to a few percent.
class RestrictedLikelihood {
 public:
  /// As estimate_noise; `precision` must outlive it.
  RestrictedLikelihood(const Linearization& linearization, const Eigen::MatrixXd& columns,
                       const Eigen::MatrixXd& precision, const Eigen::VectorXd& y);

  Score score(const NoiseParts& parts) const;
  double poses() const { return static_cast<double>(poses_.size()); }

 private:
  const Eigen::MatrixXd& precision_;
  std::vector<PoseParts> poses_;
  std::vector<Eigen::Index> first_;  // by pose: the place of its first equation
  // Equations are ordered by pose, so that the part of a pose in a matrix is contiguous in memory.
  Eigen::MatrixXd across_;  // unknowns × equations
  Eigen::VectorXd y_;
};

}  // namespace armtrue
