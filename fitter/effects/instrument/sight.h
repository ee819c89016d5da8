// Where the instrument looks: what moves a measured point along or across its line of sight.
#pragma once

#include <array>
#include <string>

#include "fitter/effects/effect.h"

namespace armtrue {

/// From the instrument to the measured point, in the measuring frame, as text.
struct Sight {
  std::string x, y, z;
  std::string across;    ///< length of its level part
  std::string distance;  ///< its length
};
Sight line_of_sight(const EffectContext& context);

/// A parameter that moves the measured point by `shift`, text in the measuring frame, less what of
/// it moves all points of the campaign as one body.
Parameter shift_of_point(const EffectContext& context, const std::string& effect,
                         const std::string& suffix, const std::string& unit, double bound,
                         const std::array<std::string, 3>& shift);

}  // namespace armtrue
