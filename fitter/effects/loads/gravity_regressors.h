// Gravity loads of unknown masses: spring constant times mass moments, fitted as one coefficient.
#pragma once

#include "fitter/effects/effect.h"

namespace armtrue {

/// One parameter for each of the arm's gravity regressors `regressor`_J_C (links J beyond the
/// joint, C = m, x, y, z) on `coordinate`, and one for the payload where it is recorded. Which of
/// them the data can tell apart (the base parameters) is decided from the data by the
/// identifiability analysis, as for geometry (Khalil and Dombre, Modeling, Identification and
/// Control of Robots, 9.4, for base parameters).
EffectTerms gravity_regressor_terms(const EffectContext& context, const std::string& effect,
                                    const std::vector<int>& joints, const std::string& regressor,
                                    const std::string& payload_regressor, Coordinate coordinate,
                                    double softest, const std::string& prefix = "");

/// Moves the terms of `more` to the end of `terms`.
void append(EffectTerms& terms, EffectTerms more);

}  // namespace armtrue
