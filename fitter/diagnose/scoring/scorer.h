// Score test of candidate blocks: the residual regressed on each block with every fitted
// parameter's column projected out.
#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

#include "fitter/common/dense.h"
#include "fitter/design/normal_equations.h"
#include "fitter/evidence/block.h"
#include "fitter/evidence/linearization.h"
#include "fitter/inference/replicates.h"

namespace armtrue {

struct BlockScore {
  int degrees = 0;         ///< independent columns after the projection, plus searched unknowns
  double gain = 0.0;       ///< fall of Σ r² (in units of the fit's own variance)
  double explained = 0.0;  ///< share of Σ r² that it explains
  double log10_p = 0.0;    ///< F test, before any correction for the number of candidates
  double delta_bic = 0.0;  ///< BIC with the block minus without
  double separability =
      0.0;               ///< of its columns, the smallest share that fitted ones cannot reproduce
  bool spanned = false;  ///< fitted columns reproduce all of its columns
  std::vector<double> coefficient, sigma;
  std::vector<double> beyond;  ///< coefficients without what fitted columns could reproduce
  std::string objection;       ///< why it is unphysical or undetermined; empty: none
};

/// Scores any number of blocks against a fit's linearization, without refitting
/// (Frisch–Waugh–Lovell; Rao's score test with the nuisance parameters' weak priors kept). Repeats
/// of one pose are weighted by their correlation (Replicates).
class Scorer {
 public:
  /// Keeps references to both.
  Scorer(const Fit& fit, const Linearization& linearization);

  /// `robust`: log10_p also from the poses' own scatter, which is the most expensive part.
  std::vector<BlockScore> score(const std::vector<Block>& blocks, bool robust = true) const;

 private:
  // Wald test with the scatter of the poses themselves (White's, clustered by pose and its
  // repeats): the residual after the block need not be white, and lies along few directions if
  // another effect is missing too. `used`: the directions that the plain test used.
  double robust_log10_p(const Eigen::MatrixXd& columns, const Eigen::MatrixXd& cross,
                        const Eigen::VectorXd& scale, const SymmetricEigen& eigen,
                        const std::vector<Eigen::Index>& used, const Eigen::VectorXd& solution,
                        int degrees) const;
  BlockScore judge(const Block& block, const Eigen::MatrixXd& columns, const Eigen::MatrixXd& cross,
                   bool robust) const;

  const Fit& fit_;
  const Linearization& l_;
  Replicates replicates_;
  double correlation_;        // of repeats
  Eigen::VectorXd white_;     // residual, whitened by it
  Eigen::MatrixXd jacobian_;  // equations × unknowns, whitened by it
  ScaledCholesky factor_;
  Eigen::VectorXd correction_;  // H⁻¹ Jᵀ r, from the remaining gradient of the fit itself
};

}  // namespace armtrue
