#include "fitter/effects/effect.h"
#include "fitter/effects/loads/gravity_regressors.h"

namespace armtrue {
namespace {

class BaseCompliance final : public Effect {
 public:
  std::string id() const override { return "base_compliance"; }
  std::string summary() const override { return "foundation tilts under the arm"; }
  JointRule joint_rule() const override { return JointRule::kNone; }
  std::string bound_text() const override {
    return "0 to 2e-3 rad under the largest moment in the data, at most 1e-4 rad/Nm (1e-5 where "
           "nobody knows the moments): ours, a stand that tilts more is loose";
  }

  EffectTerms build(const EffectContext& context, const EffectRequest&) const override {
    EffectTerms terms;
    for (int c = 0; c < 2; ++c) {
      const std::string axis = c == 0 ? "x" : "y";
      if (context.state.has("bm" + axis)) {
        Parameter p = single_term(id(), {}, "r" + axis, "rad/Nm",
                                  softest(context, "bm" + axis, kLargest, kSoftest), on_base(3 + c),
                                  "bm" + axis);
        p.sign = 1;
        p.alike = true;  // most stands are as soft about x as about y
        terms.parameters.push_back(p);
      } else {
        append(terms,
               gravity_regressor_terms(context, id(), {}, "u" + axis + "_0", "up" + axis + "_0",
                                       on_base(3 + c), kUnknown, "r" + axis + "_"));
      }
    }
    return terms;
  }

 private:
  static constexpr double kLargest = 2e-3;  // [rad]
  static constexpr double kSoftest = 1e-4;  // [rad/Nm]
  static constexpr double kUnknown = 1e-5;  // [rad/Nm] if the moments are unknown
};

const RegisterEffect<BaseCompliance> registered_base_compliance;

}  // namespace
}  // namespace armtrue
