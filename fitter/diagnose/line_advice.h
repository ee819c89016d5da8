// What may turn as often as a spectral line of a joint repeats.
#pragma once

#include <string>
#include <vector>

#include "fitter/diagnose/spectrum.h"
#include "fitter/effects/effect.h"

namespace armtrue {

/// Of a request with lines that no known order has (options cycles or wavelengths): which other
/// lines look the same where the joint stood on a grid, what to look for, and why the gear ratio,
/// where it is known, does not name them. Empty of any other request.
std::vector<std::string> line_advice(const EffectRequest& request,
                                     const std::vector<JointSpectrum>& spectra, const Robot& robot);

}  // namespace armtrue
