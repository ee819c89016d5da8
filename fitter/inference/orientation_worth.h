// What measured orientations are worth beside positions.
#pragma once

#include "fitter/inference/cross_validation.h"

namespace armtrue {

/// Factor, at least 1, by which the standard deviation of orientations is to be taken larger than
/// they scatter about the fit.
///
/// What a model lacks pulls orientations and positions apart, and it lacks more of the ones than of
/// the others: then orientations that weigh what their scatter allows make positions worse. So the
/// weight is the one with which positions that were held out are predicted best.
double orientation_inflation(const Design& design, const EvaluatedRows& evaluated,
                             double smoothness_sigma, std::uint64_t seed);

}  // namespace armtrue
