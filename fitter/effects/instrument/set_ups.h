// What the instrument was set up anew for: a column numbers the set-ups, and the first one is the
// reference.
#pragma once

#include <string>
#include <vector>

#include "fitter/effects/effect.h"

namespace armtrue {

/// Numbers in `column` after the least; none where one is no whole number.
std::vector<int> later_set_ups(const EffectContext& context, const std::string& column);

/// The column, where it is not recorded or has one number only.
std::vector<std::string> missing_set_ups(const EffectContext& context, const std::string& column);

/// A parameter that acts in one set-up alone, on all `places`.
Parameter of_set_up(const std::string& effect, const std::string& column, int number,
                    const std::string& component, const std::string& unit, double bound,
                    const std::vector<Coordinate>& places);

}  // namespace armtrue
