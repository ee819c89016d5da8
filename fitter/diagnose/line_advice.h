// Possible mechanical causes of a joint's spectral line.
#pragma once

#include <string>
#include <vector>

#include "fitter/diagnose/spectrum.h"
#include "fitter/effects/effect.h"

namespace armtrue {

/// Advice on a request that stands for spectral lines of its joint: other lines that look the same
/// on the joint's grid of positions and, unless the lines follow from a known gear, what to look
/// for and why the gear ratio, if known, does not explain them. Empty for any other request.
std::vector<std::string> line_advice(const EffectRequest& request,
                                     const std::vector<JointSpectrum>& spectra,
                                     const EffectContext& context);

}  // namespace armtrue
