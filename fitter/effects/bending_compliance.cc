#include "fitter/effects/effect.h"
#include "fitter/effects/gravity_regressors.h"

namespace armtrue {
namespace {

class BendingCompliance final : public Effect {
 public:
  std::string id() const override { return "bending_compliance"; }
  std::string summary() const override { return "link or bearing bends off its axis"; }
  JointRule joint_rule() const override { return JointRule::kEach; }
  std::string bound_text() const override {
    return "0 to 2e-4 rad/Nm: a bearing yields (docs/effects.md)";
  }

  EffectTerms build(const EffectContext& context, const EffectRequest& request) const override {
    EffectTerms terms;
    for (const int k : request.joints) {
      for (int c = 0; c < 2; ++c) {
        const std::string axis = c == 0 ? "x" : "y";
        const std::string joint = std::to_string(k);
        const std::string moment = "gm" + axis + joint;
        const Coordinate place = on_link(k, 3 + c);
        if (context.state.has(moment)) {
          Parameter p = single_term(id(), {k}, "r" + axis, "rad/Nm", kSoftest, place, moment);
          p.sign = 1;
          terms.parameters.push_back(p);
        } else {
          append(terms, gravity_regressor_terms(context, id(), {k}, "u" + axis + "_" + joint,
                                                "up" + axis + "_" + joint, place, kSoftest,
                                                "r" + axis + "_"));
        }
      }
    }
    return terms;
  }

 private:
  static constexpr double kSoftest = 2e-4;  // [rad/Nm]
};

const RegisterEffect<BendingCompliance> registered_bending_compliance;

}  // namespace
}  // namespace armtrue
