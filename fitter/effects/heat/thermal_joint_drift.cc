#include "fitter/effects/effect.h"

namespace armtrue {
namespace {

class ThermalJointDrift final : public Effect {
 public:
  ThermalJointDrift()
      : Effect({.id = "thermal_joint_drift",
                .summary = "joint zero moves with temperature",
                .bound = "2e-4 rad/K, 5e-5 m/K where it slides: ours",
                .by_sensor = true}) {}

  EffectTerms build(const EffectContext& context, const EffectRequest& request) const override {
    EffectTerms terms;
    for (const int k : request.joints) {
      add(terms, {k}, "", motor_unit(context, k) + "/K", on_motor(context, k, 2e-4, 5e-5), motor(k),
          temperature_variable(request));
    }
    return terms;
  }
};

const RegisterEffect<ThermalJointDrift> registered_thermal_joint_drift;

}  // namespace
}  // namespace armtrue
