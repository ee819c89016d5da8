// Effects on all springs of a fit at once: changes of the loads that they carry.
#pragma once

#include <functional>
#include <string>

#include "fitter/effects/effect.h"

namespace armtrue {

/// An effect of the whole arm on the loads of its springs.
class LoadEffect : public Effect {
 public:
  explicit LoadEffect(EffectTraits traits);
  /// Needs masses, and springs that carry them.
  std::vector<std::string> missing(const EffectContext& context,
                                   const std::vector<int>& joints) const override;

 protected:
  /// Adds a parameter that changes the loads: on each spring its compliance times `change(load)`,
  /// the derivative of the load by the parameter (a state variable or an expression; empty: none).
  /// Nothing if it changes no load in these data.
  void add_change(const EffectContext& context, const std::string& suffix, const std::string& unit,
                  double bound, double usual,
                  const std::function<std::string(const Variable&)>& change,
                  EffectTerms& terms) const;
};

}  // namespace armtrue
