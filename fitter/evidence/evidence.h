// How probable every effect of the catalogue is, what scatters, and what the likeliest set of
// effects leaves.
#pragma once

#include <set>
#include <string>
#include <vector>

#include "fitter/evidence/blocks.h"
#include "fitter/evidence/noise.h"

namespace armtrue {

struct EvidenceOptions {
  int sweeps = 60;
  /// Labels of the effects of the fit that a search put in; the owner of the arm believes in the
  /// others.
  std::set<std::string> searched;
};

struct EvidenceSummary {
  std::vector<EvidenceBlock> blocks;
  SearchResult search;
  NoiseParts noise;      ///< at the likeliest set
  double freedom = 1.0;  ///< equations less effective unknowns of base and the likeliest set
};

/// Searches, estimates the noise at what was found, and searches again. `catalogue`: what may enter
/// (catalogue_blocks); `extra`: what may beside it.
EvidenceSummary weigh_evidence(Fit& fit, const Linearization& linearization,
                               std::vector<Block> catalogue, std::vector<EvidenceBlock> extra,
                               const EvidenceOptions& options);

}  // namespace armtrue
