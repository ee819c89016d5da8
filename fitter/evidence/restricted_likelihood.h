// How probable a residual is under the standard deviations of NoiseParts, whatever the model's
// coefficients are, and how that changes with each of them.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <vector>

#include "fitter/evidence/linearization.h"
#include "fitter/evidence/noise.h"

namespace armtrue {

/// The first equations of a row are its position's, those behind them its orientation's.
inline constexpr int kPositionEquations = 3;

/// Columns of every part within the equations of one pose.
struct PoseParts {
  std::vector<Eigen::Index> equations;
  std::vector<bool> turns;             ///< by equation: of an orientation
  std::vector<Eigen::MatrixXd> joint;  ///< by joint: equations × visits
  Eigen::MatrixXd shared;              ///< equations × 3
};

/// Of every `stride`-th pose.
std::vector<PoseParts> parts_of_poses(const Linearization& linearization, std::size_t stride = 1);

/// L⁻¹ of a pose's covariance LLᵀ.
Eigen::MatrixXd inverse_root_of(const PoseParts& pose, const NoiseParts& parts);

/// Variances in the order of Score: the reading, each joint, what a pose's readings share, the
/// orientation.
Eigen::VectorXd variances_of(const NoiseParts& parts);

/// The logarithm of the restricted likelihood, its slope by the variances, and their Fisher
/// information (Patterson and Thompson 1971, Biometrika 58, 545).
struct Score {
  double value = 0.0;
  Eigen::VectorXd slope;
  Eigen::MatrixXd information;
};

/// Of so many poses as tell variances to some hundredths.
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
  // The equations of a pose stand side by side, so that its share of a matrix is one piece of
  // memory.
  Eigen::MatrixXd across_;  // unknowns × equations
  Eigen::VectorXd y_;
};

}  // namespace armtrue
