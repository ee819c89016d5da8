// The noise in parts: of single readings, of each joint's repeatability, and common to all readings
// of a pose.
#pragma once

#include <Eigen/Core>
#include <functional>
#include <optional>
#include <vector>

#include "fitter/evidence/linearization.h"

namespace armtrue {

/// One standard deviation of each part.
struct NoiseParts {
  double reading = 1.0;  ///< in units of the instrument's own sigma (Linearization::typical_sigma)
  double orientation = 1.0;  ///< of measured orientations, in units of the sigma that the fit gives
                             ///< them: below `reading` where it gives them less weight
  std::vector<double>
      joint;  ///< by joint, motor side [rad or m]: new at each visit, the same in its readings
  std::vector<bool> pooled;  ///< by joint: has one value with the other pooled joints; may be empty
  std::optional<double>
      pose;  ///< [m], shared by all readings of a pose; none where no pose has two readings

  bool is_pooled(std::size_t k) const { return !pooled.empty() && pooled[k]; }
};

/// Whitens columns for ordinary least squares: unit variance, no correlation. The covariance σ² + Σ
/// ρ_k² m_k m_kᵀ + κ² 1 1ᵀ has one block for each pose. If the fit gives orientations a small
/// weight, they keep it: their σ is taken no smaller than that of positions.
class PoseWhitening {
 public:
  PoseWhitening(const Linearization& linearization, const NoiseParts& parts);

  void apply(Eigen::Ref<Eigen::MatrixXd> columns) const;
  struct Block {
    std::vector<Eigen::Index> equations;
    Eigen::MatrixXd inverse_root;  ///< lower triangle
  };
  /// One for each pose, in Linearization::poses' order.
  const std::vector<Block>& blocks() const { return blocks_; }

 private:
  std::vector<Block> blocks_;
};

/// Number of equations of a linearisation, as equations_that_count counts them, from the estimated
/// variances.
double counted_equations(const Linearization& linearization, const NoiseParts& parts);

struct NoiseEffort {
  int steps = 12;
  bool drops_unsure = true;  ///< parts that the data do not support are pooled or become zero
};

/// Maximises the restricted likelihood (Patterson and Thompson 1971, Biometrika 58, 545) by Fisher
/// scoring, within bounds that keep every variance positive. `columns`: of the model, whitened by
/// the instrument; `precision`: of the prior of their coefficients, which has mean zero; `y`: what
/// they explain. Starts at `start`.
NoiseParts estimate_noise(const Linearization& linearization, const Eigen::MatrixXd& columns,
                          const Eigen::MatrixXd& precision, const Eigen::VectorXd& y,
                          const NoiseParts& start, const NoiseEffort& effort);

/// Start of an estimate, deliberately large: half of the mean square is given to readings, half to
/// the joints, and all of it again to what readings of a pose share.
NoiseParts broad_noise(const Linearization& linearization, const Eigen::VectorXd& residual);

}  // namespace armtrue
