#include "fitter/effects/effect.h"

namespace armtrue {
namespace {

class JointOffset final : public Effect {
 public:
  std::string id() const override { return "joint_offset"; }
  std::string summary() const override { return "encoder zero"; }
  Role role() const override { return Role::kGeometry; }
  JointRule joint_rule() const override { return JointRule::kEach; }
  std::string bound_text() const override {
    return "2 deg or 10 mm: zeros found in the field are 0.01 to 0.15 deg";
  }

  EffectTerms build(const EffectContext& context, const EffectRequest& request) const override {
    EffectTerms terms;
    for (const int k : request.joints) {
      const bool slides = context.prismatic(k);
      Parameter p =
          single_term(id(), {k}, "", slides ? "m" : "rad", slides ? 0.01 : 0.035, motor(k), "1");
      p.prior_sigma = slides ? context.priors.length : context.priors.angle;
      terms.parameters.push_back(p);
    }
    return terms;
  }
};

const RegisterEffect<JointOffset> registered_joint_offset;

}  // namespace
}  // namespace armtrue
