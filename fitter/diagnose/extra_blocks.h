// Candidates beside the catalogue, which the residual itself suggests.
#pragma once

#include <vector>

#include "fitter/diagnose/spectrum.h"
#include "fitter/diagnose/structure.h"
#include "fitter/evidence/blocks.h"

namespace armtrue {

/// Spectral lines as candidates, unless the catalogue's own orders cover them already.
std::vector<EvidenceBlock> spectral_blocks(const Fit& fit, const Linearization& linearization,
                                           const std::vector<JointSpectrum>& spectra);

/// Findings as candidates: smooth functions and events that no effect explains. They compete with
/// the catalogue, so that the search drops those that only imitate an effect.
std::vector<EvidenceBlock> structure_blocks(const Fit& fit, const Structure& structure);

}  // namespace armtrue
