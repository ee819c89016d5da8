// Start values of nonlinear parameters: a time constant, an order, a balancer's geometry.
#pragma once

#include <vector>

#include "fitter/design/design.h"

namespace armtrue {

/// Unknowns of `design` from which a descent ends in the best minimum that the starts of the
/// nonlinear parameters lead to.
///
/// The chain is linearised once, at the design's present values, on at most a few hundred
/// measurements. All linear unknowns that do not multiply a nonlinear parameter are projected out
/// (variable projection: Golub and Pereyra 1973), so that a start costs only its own columns. Every
/// combination of starts is tried, and a descent follows each of the most promising.
/// Leaves the design at its present values.
std::vector<double> search_starts(Design& design, double smoothness_sigma);

}  // namespace armtrue
