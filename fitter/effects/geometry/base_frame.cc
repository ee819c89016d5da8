#include "fitter/effects/effect.h"

namespace armtrue {
namespace {

class BaseFrame final : public Effect {
 public:
  std::string id() const override { return "base_frame"; }
  std::string summary() const override { return "robot base in the measuring frame"; }
  Role role() const override { return Role::kPlacement; }
  JointRule joint_rule() const override { return JointRule::kNone; }
  std::string bound_text() const override { return "none: the base may stand anywhere"; }

  EffectTerms build(const EffectContext&, const EffectRequest&) const override {
    EffectTerms terms;
    for (int c = 0; c < 6; ++c) {
      Parameter p =
          single_term(id(), {}, kComponentNames[c], c < 3 ? "m" : "rad", 0.0, on_base(c), "1");
      p.exported = false;
      terms.parameters.push_back(p);
    }
    return terms;
  }

  std::vector<EffectRequest> candidates(const EffectContext&) const override {
    return {{id(), {}}};
  }
};

const RegisterEffect<BaseFrame> registered_base_frame;

}  // namespace
}  // namespace armtrue
