// Where to begin with nonlinear parameters: a time constant, an order, a balancer's geometry.
#pragma once

#include <vector>

#include "fitter/design/design.h"

namespace armtrue {

/// Unknowns of `design` from which a descent ends in the best minimum that the nonlinear
/// parameters' starts lead to.
///
/// The chain is linearised once, at the design's present values, on at most a few hundred
/// measurements. All that is linear and does not multiply a nonlinear parameter is projected out
/// (variable projection: Golub and Pereyra 1973), so that a start costs only its own columns: every
/// combination of starts is tried, and the most promising are followed to their minimum.
/// Leaves the design at its present values.
std::vector<double> search_starts(Design& design, double smoothness_sigma);

}  // namespace armtrue
