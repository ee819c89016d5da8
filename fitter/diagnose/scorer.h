// Score test of candidate blocks: the residual regressed on each block with every fitted
// parameter's column projected out.
#pragma once

#include <Eigen/Core>
#include <map>
#include <span>
#include <string>
#include <vector>

#include "fitter/common/dense.h"
#include "fitter/design/normal_equations.h"
#include "fitter/evidence/block.h"
#include "fitter/inference/replicates.h"

namespace armtrue {

struct BlockScore {
  int degrees = 0;         ///< independent columns that survive, searched unknowns included
  double gain = 0.0;       ///< fall of Σ r² (in units of the fit's own variance)
  double explained = 0.0;  ///< share of Σ r²
  double log10_p = 0.0;    ///< F test, before any correction for the number of candidates
  double delta_bic = 0.0;  ///< BIC with the block minus without
  double separability =
      0.0;  ///< least share of a column's information that survives the projection
  std::vector<double> coefficient, sigma;
  std::string objection;  ///< why it is not physical or cannot be known; empty: none
};

/// Holds a fit's Jacobian and residual and scores any number of blocks against them, without
/// refitting (Frisch–Waugh–Lovell; Rao's score test with the nuisance parameters' weak priors
/// kept). Repeats of one pose count for what they add to one another (Replicates).
class Scorer {
 public:
  explicit Scorer(Fit& fit);

  /// `robust`: log10_p from the poses' own scatter too, which costs more than all else.
  std::vector<BlockScore> score(const std::vector<Block>& blocks, bool robust = true) const;

  /// Columns of all parameters of some blocks, one after the other: whitened by the instrument as
  /// residual() is, not yet by repeats.
  Eigen::MatrixXd columns(std::span<const Block> blocks) const;

  std::size_t equations() const { return static_cast<std::size_t>(residual_.size()); }
  double residual_sum() const { return residual_.squaredNorm(); }
  double degrees_of_freedom() const { return freedom_; }
  /// Whitened residual (predicted − measured) and rows used, residuals_per_row() entries a row.
  const Eigen::VectorXd& residual() const { return residual_; }
  const std::vector<std::size_t>& rows() const { return rows_; }
  int height() const { return height_; }
  /// Whitened change of every residual by one coordinate, height × rows.
  Eigen::VectorXd coordinate_column(int coordinate) const { return geometry_.col(coordinate); }
  const CoordinateLayout& layout() const { return layout_; }

 private:
  // Wald test with the scatter of the poses themselves (White's, clustered by pose and its
  // repeats): what is left over after the block need not be white, and acts along few directions
  // when something else is missing too. `used`: the directions that the plain test used.
  double robust_log10_p(const Eigen::MatrixXd& columns, const Eigen::MatrixXd& cross,
                        const Eigen::VectorXd& scale, const SymmetricEigen& eigen,
                        const std::vector<Eigen::Index>& used, const Eigen::VectorXd& solution,
                        int degrees) const;
  BlockScore judge(const Block& block, const Eigen::MatrixXd& columns, const Eigen::MatrixXd& cross,
                   bool robust) const;

  using BasisCache = std::map<std::string, std::vector<double>>;
  Eigen::MatrixXd columns(std::span<const Block> blocks, BasisCache& cache) const;

  Fit& fit_;
  CoordinateLayout layout_;
  int height_;
  std::vector<std::size_t> rows_;
  Eigen::VectorXd residual_;
  Replicates replicates_;
  double correlation_ = 0.0;  // of repeats
  Eigen::VectorXd white_;     // residual_ without it
  Eigen::MatrixXd jacobian_;  // equations × unknowns, without it
  Eigen::MatrixXd geometry_;  // equations × coordinates
  ScaledCholesky factor_;
  Eigen::VectorXd correction_;  // H⁻¹ Jᵀ r: what is left of the fit's own gradient
  double freedom_ = 1.0;
};

}  // namespace armtrue
