#include "fitter/effects/effect.h"
#include "fitter/effects/gravity_regressors.h"

namespace armtrue {
namespace {

class BaseCompliance final : public Effect {
 public:
  std::string id() const override { return "base_compliance"; }
  std::string summary() const override { return "foundation tilts under the arm"; }
  JointRule joint_rule() const override { return JointRule::kNone; }
  std::string bound_text() const override {
    return "0 to 1e-5 rad/Nm: a stand yields (docs/effects.md)";
  }

  EffectTerms build(const EffectContext& context, const EffectRequest&) const override {
    EffectTerms terms;
    for (int c = 0; c < 2; ++c) {
      const std::string axis = c == 0 ? "x" : "y";
      if (context.state.has("bm" + axis)) {
        Parameter p =
            single_term(id(), {}, "r" + axis, "rad/Nm", kSoftest, on_base(3 + c), "bm" + axis);
        p.sign = 1;
        terms.parameters.push_back(p);
      } else {
        append(terms,
               gravity_regressor_terms(context, id(), {}, "u" + axis + "_0", "up" + axis + "_0",
                                       on_base(3 + c), kSoftest, "r" + axis + "_"));
      }
    }
    return terms;
  }

 private:
  static constexpr double kSoftest = 1e-5;  // [rad/Nm]
};

const RegisterEffect<BaseCompliance> registered_base_compliance;

}  // namespace
}  // namespace armtrue
