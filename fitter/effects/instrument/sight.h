// The instrument's line of sight: parameters that move a measured point along or across it.
#pragma once

#include <array>
#include <string>

#include "fitter/effects/effect.h"

namespace armtrue {

/// Vector from the instrument to the measured point in the measuring frame, as expressions.
struct Sight {
  std::string x, y, z;
  std::string across;    ///< length of its horizontal part
  std::string distance;  ///< length
};
Sight line_of_sight(const EffectContext& context);

/// Adds a parameter that moves the measured point by `shift` (expressions in the measuring frame),
/// without the part that moves all points of the campaign as one rigid body.
void shift_of_point(const EffectContext& context, const Effect& effect, const std::string& suffix,
                    const std::string& unit, double bound, const std::array<std::string, 3>& shift,
                    EffectTerms& terms);

}  // namespace armtrue
