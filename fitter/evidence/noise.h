// What scatters, in parts: the reading, what each joint does not repeat, what the readings of a
// pose share.
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
      joint;  ///< by joint, motor side [rad or m]: anew at each visit, shared by its readings
  std::vector<bool> pooled;  ///< by joint: not told from others, which have its value; may be empty
  std::optional<double>
      pose;  ///< [m], shared by all readings of a pose; none where no pose has two readings

  bool is_pooled(std::size_t k) const { return !pooled.empty() && pooled[k]; }
};

/// Turns columns into such as ordinary least squares may take: unit variance, no correlation. The
/// covariance σ² + Σ ρ_k² m_k m_kᵀ + κ² 1 1ᵀ has one block for each pose. Where the fit gives
/// orientations a small weight they keep it: their σ is taken no smaller than that of positions.
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
  bool drops_unsure = true;  ///< parts that do not pay for themselves are pooled or become zero
};

/// Restricted likelihood (Patterson and Thompson 1971, Biometrika 58, 545), climbed by Fisher's
/// scoring within bounds that keep every variance positive. `columns`: what the model has, whitened
/// by the instrument; `precision`: of the prior of their coefficients, which `target` centres at
/// zero. `y`: what they explain. Begins at `start`.
NoiseParts estimate_noise(const Linearization& linearization, const Eigen::MatrixXd& columns,
                          const Eigen::MatrixXd& precision, const Eigen::VectorXd& y,
                          const NoiseParts& start, const NoiseEffort& effort);

/// Where an estimate begins: as if half of the squares were the joints' own, and all of them a
/// pose's.
NoiseParts broad_noise(const Linearization& linearization, const Eigen::VectorXd& residual);

}  // namespace armtrue
