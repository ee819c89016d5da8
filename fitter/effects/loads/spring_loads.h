// What moves all springs of a fit at once: a change of the loads that they
// carry.
#pragma once

#include <functional>
#include <string>

#include "fitter/effects/effect.h"

namespace armtrue {

/// A parameter that changes the loads: on each spring its compliance times
/// `change(load)`, the state variable or expression that is the load's
/// derivative by the parameter; empty: none. No terms where it changes no load
/// in these data.
Parameter load_change(const EffectContext& context, const std::string& effect,
                      const std::string& suffix, const std::string& unit, double bound,
                      double usual, const std::function<std::string(const Variable&)>& change);

/// An effect of the whole arm on the loads that its springs carry.
class LoadEffect : public Effect {
 public:
  JointRule joint_rule() const override { return JointRule::kNone; }
  bool reads_springs() const override { return true; }
  /// Masses, and springs that carry them.
  std::vector<std::string> missing(const EffectContext& context,
                                   const std::vector<int>& joints) const override;
};

}  // namespace armtrue
