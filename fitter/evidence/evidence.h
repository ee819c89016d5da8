// The probability of every effect of the catalogue, the noise, and the residual of the likeliest
// set of effects.
#pragma once

#include <set>
#include <string>
#include <vector>

#include "fitter/evidence/blocks.h"
#include "fitter/evidence/noise.h"

namespace armtrue {

struct EvidenceOptions {
  int sweeps = 60;
  /// Labels of the effects of the fit that a search added; the user put in the others, which have
  /// higher prior odds.
  std::set<std::string> searched;
};

struct EvidenceSummary {
  std::vector<EvidenceBlock> blocks;
  SearchResult search;
  NoiseParts noise;      ///< at the likeliest set
  double freedom = 1.0;  ///< equations less effective unknowns of base and the likeliest set
};

/// Alternates searches with estimates of the noise beside the set found. `catalogue`: candidates of
/// the catalogue (catalogue_blocks); `extra`: further candidates.
EvidenceSummary weigh_evidence(Fit& fit, const Linearization& linearization,
                               std::vector<Block> catalogue, std::vector<EvidenceBlock> extra,
                               const EvidenceOptions& options);

}  // namespace armtrue
