#include "fitter/effects/effect.h"

namespace armtrue {
namespace {

class JointOffset final : public Effect {
 public:
  JointOffset()
      : Effect({.id = "joint_offset",
                .summary = "encoder zero",
                .bound = "2 deg or 10 mm: zeros found in the field are 0.01 to 0.15 deg",
                .role = Role::kGeometry}) {}

  EffectTerms build(const EffectContext& context, const EffectRequest& request) const override {
    EffectTerms terms;
    for (const int k : request.joints) {
      add(terms, {k}, "", motor_unit(context, k), on_motor(context, k, 0.035, 0.01), motor(k), "1")
          .prior_sigma = on_motor(context, k, context.priors.angle, context.priors.length);
    }
    return terms;
  }
};

const RegisterEffect<JointOffset> registered_joint_offset;

}  // namespace
}  // namespace armtrue
