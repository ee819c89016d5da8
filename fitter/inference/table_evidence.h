// Evidence of models with tables. Smoothness ties the nodes of a table to one another, so they do
// not count as independent parameters.
#pragma once

#include "fitter/design/normal_equations.h"

namespace armtrue {

/// −2 log of the marginal likelihood of a linearised model whose tables have their penalties as a
/// Gaussian prior (MacKay 1992, Neural Computation 4, 415; Wood 2011, J. R. Statist. Soc. B 73, 3).
/// It is not integrated over parameters outside tables: information criteria count those.
struct TableEvidence {
  double penalty = 0.0;  ///< Σ (penalty rows of table nodes)², in units of the noise's variance
  double occam = 0.0;  ///< log |A + P| − log |P| over the nodes, the other unknowns projected out
};

/// The two parts at the design's present values. `information` is JᵀJ in units of the noise's
/// variance, penalties not yet added. Zeros without tables.
TableEvidence table_evidence(const Design& design, Eigen::MatrixXd information,
                             double smoothness_sigma);

/// Standard deviations of second differences that are tried for tables [rad or m].
const std::vector<double>& smoothnesses();

/// The element of `candidates` [rad or m] with the largest evidence. Each is evaluated at its own
/// best solution, one linearised step from the design's present values.
struct LikeliestSmoothness {
  double sigma;     ///< [rad or m]
  double evidence;  ///< −2 log of the marginal likelihood, up to a constant of the data
};
LikeliestSmoothness likeliest_smoothness(const Design& design, const NormalEquations& data,
                                         const std::vector<double>& candidates);

}  // namespace armtrue
