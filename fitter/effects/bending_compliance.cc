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
    return "0 to 5e-3 rad under the largest moment in the data, at most 1e-3 rad/Nm: ours, half of "
           "what a gear may yield, for a bearing is stiffer (docs/effects.md)";
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
          Parameter p = single_term(id(), {k}, "r" + axis, "rad/Nm",
                                    softest(context, moment, kLargest, kSoftest), place, moment);
          p.sign = 1;
          terms.parameters.push_back(p);
        } else {
          append(terms, gravity_regressor_terms(context, id(), {k}, "u" + axis + "_" + joint,
                                                "up" + axis + "_" + joint, place, kUnknown,
                                                "r" + axis + "_"));
        }
      }
    }
    return terms;
  }

 private:
  static constexpr double kLargest = 5e-3;  // [rad]
  static constexpr double kSoftest = 1e-3;  // [rad/Nm]
  static constexpr double kUnknown = 2e-4;  // [rad/Nm] where nobody knows the moments
};

const RegisterEffect<BendingCompliance> registered_bending_compliance;

}  // namespace
}  // namespace armtrue
