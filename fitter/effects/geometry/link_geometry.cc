#include "fitter/effects/effect.h"

namespace armtrue {
namespace {

class LinkGeometry final : public Effect {
 public:
  LinkGeometry()
      : Effect({.id = "link_geometry",
                .summary = "lengths, twists and offsets of a link",
                .bound = "10 mm, 2 deg: axis offsets found in the field are 0.1 to 2 mm",
                .role = Role::kGeometry}) {}

  EffectTerms build(const EffectContext& context, const EffectRequest& request) const override {
    EffectTerms terms;
    for (const int k : request.joints) {
      for (int c = 0; c < 5; ++c) {
        add(terms, {k}, kComponentNames[c], c < 3 ? "m" : "rad", c < 3 ? 0.01 : 0.035,
            on_link(k, c), "1")
            .prior_sigma = c < 3 ? context.priors.length : context.priors.angle;
      }
    }
    return terms;
  }
};

const RegisterEffect<LinkGeometry> registered_link_geometry;

}  // namespace
}  // namespace armtrue
