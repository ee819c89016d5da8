// The weight of measured orientations relative to positions.
#pragma once

#include "fitter/inference/cross_validation.h"

namespace armtrue {

/// Factor, at least 1, by which the standard deviation of orientations is increased above their
/// scatter about the fit.
///
/// Effects that the model lacks may disturb orientations more than positions, or the reverse.
/// Orientations weighted by their scatter alone then make positions worse. So the factor is the one
/// with which held-out positions are predicted best.
double orientation_inflation(const Design& design, const EvaluatedRows& evaluated,
                             double smoothness_sigma, std::uint64_t seed);

}  // namespace armtrue
