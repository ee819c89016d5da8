// Start values of nonlinear parameters: a time constant, an order, a balancer's geometry.
#pragma once

#include <vector>

#include "fitter/design/design.h"

namespace armtrue {

/// Values of the unknowns of `design` from which a descent reaches the lowest minimum that was
/// found from the starts of the nonlinear parameters.
///
/// The chain is linearised once, at the design's present values, on about 1200 equations,
/// or two for each unknown. All linear unknowns whose basis contains no nonlinear parameter are
/// projected out (variable projection: Golub and Pereyra 1973), so that a start evaluates only the
/// other columns. Every combination of starts is tried, and a descent follows from each of the
/// best. Leaves the design at its present values.
std::vector<double> search_starts(Design& design, double smoothness_sigma);

}  // namespace armtrue
