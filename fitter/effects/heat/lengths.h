// Links that grow: one coefficient times the nominal lengths, for any cause of growth.
#pragma once

#include "fitter/effects/effect.h"

namespace armtrue {

/// Adds a parameter that adds coefficient × `growth` × nominal length on tx ty tz of links `first`
/// to `last` (0: the base; link k: from frame k to the next joint, in frame k).
Parameter& grown_lengths(const EffectContext& context, const Effect& effect,
                         const std::vector<int>& joints, const std::string& suffix,
                         const std::string& unit, double bound, int first, int last,
                         const std::string& growth, EffectTerms& terms);

}  // namespace armtrue
