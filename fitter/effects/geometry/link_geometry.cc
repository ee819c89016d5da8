#include "fitter/effects/effect.h"

namespace armtrue {
namespace {

class LinkGeometry final : public Effect {
 public:
  std::string id() const override { return "link_geometry"; }
  std::string summary() const override { return "lengths, twists and offsets of a link"; }
  Role role() const override { return Role::kGeometry; }
  JointRule joint_rule() const override { return JointRule::kEach; }
  std::string bound_text() const override {
    return "10 mm, 2 deg: axis offsets found in the field are 0.1 to 2 mm";
  }

  EffectTerms build(const EffectContext& context, const EffectRequest& request) const override {
    EffectTerms terms;
    for (const int k : request.joints) {
      for (int c = 0; c < 5; ++c) {
        Parameter p = single_term(id(), {k}, kComponentNames[c], c < 3 ? "m" : "rad",
                                  c < 3 ? 0.01 : 0.035, on_link(k, c), "1");
        p.prior_sigma = c < 3 ? context.priors.length : context.priors.angle;
        terms.parameters.push_back(p);
      }
    }
    return terms;
  }
};

const RegisterEffect<LinkGeometry> registered_link_geometry;

}  // namespace
}  // namespace armtrue
