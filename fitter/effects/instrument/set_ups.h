// Repeated set-ups of the instrument or a reflector: a column numbers them, and the lowest number
// is the reference.
#pragma once

#include <string>
#include <vector>

#include "fitter/effects/effect.h"

namespace armtrue {

/// Numbers in `column` except the lowest; empty if one of them is not an integer.
std::vector<int> later_set_ups(const EffectContext& context, const std::string& column);

/// What is missing: `column` itself, or whole numbers of two set-ups in it; empty: nothing.
std::vector<std::string> missing_set_ups(const EffectContext& context, const std::string& column);

/// A parameter that acts only in set-up `number`, on all `places`.
Parameter of_set_up(const std::string& effect, const std::string& column, int number,
                    const std::string& component, const std::string& unit, double bound,
                    const std::vector<Coordinate>& places);

}  // namespace armtrue
