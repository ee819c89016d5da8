// What a search looks at beside the catalogue: what the residual itself shows.
#pragma once

#include <vector>

#include "fitter/diagnose/spectrum.h"
#include "fitter/diagnose/structure.h"
#include "fitter/evidence/blocks.h"

namespace armtrue {

/// Lines of the spectra as candidates, where the catalogue's own orders do not cover them already.
std::vector<EvidenceBlock> spectral_blocks(const Fit& fit, const Linearization& linearization,
                                           const std::vector<JointSpectrum>& spectra);

/// Smooth functions that no effect names compete with the catalogue: what only stands in for one of
/// them goes.
std::vector<EvidenceBlock> structure_blocks(const Fit& fit, const Structure& structure);

}  // namespace armtrue
