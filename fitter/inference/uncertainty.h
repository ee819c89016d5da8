// How well a solution is known: covariance, effective unknowns, and what the data taught.
#pragma once

#include <Eigen/Core>

#include "fitter/inference/table_evidence.h"

namespace armtrue {

struct Uncertainty {
  /// Unknowns less what priors and smoothness hold: the trace of the hat matrix.
  double effective_unknowns = 0.0;
  /// −log of variances over those of the priors, along the principal directions outside tables.
  Eigen::VectorXd learnt;
  TableEvidence tables;

  /// What BIC charges for the unknowns when so many `coordinates` are measured: the logarithm of
  /// that for what the data know well, less for what they hardly know better than it was known
  /// before (docs/decisions/0006-diagnosis.md); tables by their marginal likelihood.
  double charge_for_unknowns(double coordinates) const;
};

/// Of a design at its solution. What was learnt counts shots of one visit for less where what they
/// leave is alike. `guess`: an approximate number of effective unknowns, which saves iterations; 0:
/// not known.
Uncertainty measure_uncertainty(const Design& design, const EvaluatedRows& evaluated,
                                double smoothness_sigma, double guess = 0.0);

/// Covariance of a design's unknowns at its solution, with the scatter of joints and of poses in it
/// (scatter_parts.h).
Eigen::MatrixXd covariance_of(const Design& design, double smoothness_sigma, double guess = 0.0);

/// The effective number of unknowns alone, from the measurements' normal equations.
double count_effective_unknowns(const Design& design, const NormalEquations& equations,
                                double smoothness_sigma, double guess = 0.0);

}  // namespace armtrue
