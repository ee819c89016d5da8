#include "fitter/effects/effect.h"

namespace armtrue {
namespace {

class ThermalBase final : public Effect {
 public:
  ThermalBase()
      : Effect({.id = "thermal_base",
                .summary = "stand or pedestal warps with temperature",
                .bound = "1e-4 m/K, 1e-4 rad/K: ours",
                .joints = JointRule::kNone,
                .by_sensor = true}) {}

  EffectTerms build(const EffectContext&, const EffectRequest& request) const override {
    EffectTerms terms;
    for (int c = 0; c < 6; ++c) {
      add(terms, {}, kComponentNames[c], c < 3 ? "m/K" : "rad/K", 1e-4, on_base(c),
          temperature_variable(request));
    }
    return terms;
  }
};

const RegisterEffect<ThermalBase> registered_thermal_base;

}  // namespace
}  // namespace armtrue
