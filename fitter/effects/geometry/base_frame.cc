#include "fitter/effects/effect.h"

namespace armtrue {
namespace {

class BaseFrame final : public Effect {
 public:
  BaseFrame()
      : Effect({.id = "base_frame",
                .summary = "robot base in the measuring frame",
                .bound = "none: the base may stand anywhere",
                .role = Role::kPlacement,
                .joints = JointRule::kNone}) {}

  EffectTerms build(const EffectContext&, const EffectRequest&) const override {
    EffectTerms terms;
    for (int c = 0; c < 6; ++c) {
      add(terms, {}, kComponentNames[c], c < 3 ? "m" : "rad", 0.0, on_base(c), "1");
    }
    return terms;
  }
};

const RegisterEffect<BaseFrame> registered_base_frame;

}  // namespace
}  // namespace armtrue
