// Uncertainty of a solution: covariance, effective unknowns, and what the data add to the priors.
#pragma once

#include <Eigen/Core>

#include "fitter/inference/table_evidence.h"

namespace armtrue {

struct Uncertainty {
  /// Number of unknowns that the data determine, not priors or smoothness: trace of the hat matrix.
  double effective_unknowns = 0.0;
  /// −log (posterior / prior variance), along the principal directions outside tables.
  Eigen::VectorXd learnt;
  TableEvidence tables;

  /// BIC's penalty for the unknowns if this many `coordinates` are measured: ln(coordinates) for
  /// each direction that the data determine well, less for those hardly better known than from the
  /// priors (docs/decisions/0006-diagnosis.md); tables by their marginal likelihood.
  double charge_for_unknowns(double coordinates) const;
};

/// Uncertainty of a design at its solution. In `learnt`, repeated readings of a pose count less if
/// their residuals are correlated. `guess`: an approximate number of effective unknowns, which
/// saves iterations; 0: not known.
Uncertainty measure_uncertainty(const Design& design, const EvaluatedRows& evaluated,
                                double smoothness_sigma, double guess = 0.0);

/// Covariance of a design's unknowns at its solution, including the scatter of joints and of poses
/// (scatter_parts.h).
Eigen::MatrixXd covariance_of(const Design& design, double smoothness_sigma, double guess = 0.0);

/// The effective number of unknowns alone, from the measurements' normal equations.
double count_effective_unknowns(const Design& design, const NormalEquations& equations,
                                double smoothness_sigma, double guess = 0.0);

}  // namespace armtrue
