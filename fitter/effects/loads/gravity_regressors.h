// Gravity loads of unknown masses: spring constant times mass moments, fitted as one coefficient.
#pragma once

#include "fitter/effects/effect.h"

namespace armtrue {

/// Adds one parameter for each of the arm's gravity regressors u`load`_J_C (links J beyond the
/// joint, C = m, x, y, z; `load`: "_2", or "x_0" for the base's moment about x) on `coordinate`,
/// and one for the payload where it is recorded. Which of them the data can tell apart (the base
/// parameters) is decided from the data by the identifiability analysis, as for geometry (Khalil
/// and Dombre, Modeling, Identification and Control of Robots, 9.4, for base parameters).
void add_gravity_regressors(const EffectContext& context, const Effect& effect,
                            const std::vector<int>& joints, const std::string& load,
                            Coordinate coordinate, double softest, const std::string& prefix,
                            EffectTerms& terms);

/// Largest turn [rad], compliance [rad/Nm], and compliance if the moments are unknown.
struct Softness {
  double largest, softest, unknown;
};

/// Adds parameters of a bearing, or of the base (`link` 0), that gravity's moments about x and y of
/// its frame tilt.
void add_tilting(const EffectContext& context, const Effect& effect, int link,
                 const Softness& limits, EffectTerms& terms);

}  // namespace armtrue
