// Repeated set-ups of the instrument or a reflector: the column with the effect's name numbers
// them, and the lowest number is the reference.
#pragma once

#include <string>
#include <vector>

#include "fitter/effects/effect.h"

namespace armtrue {

/// An effect with parameters of its own for every further set-up.
class SetUpEffect : public Effect {
 public:
  using Effect::Effect;
  /// The column itself, or whole numbers of two set-ups in it.
  std::vector<std::string> missing(const EffectContext& context,
                                   const std::vector<int>& joints) const override;
  EffectTerms build(const EffectContext& context, const EffectRequest& request) const override;

 protected:
  /// Where a set-up acts: coordinates that share one parameter.
  struct Places {
    std::string component, unit;
    double bound;
    std::vector<Coordinate> coordinates;
  };
  virtual std::vector<Places> places(const EffectContext& context) const = 0;
};

}  // namespace armtrue
