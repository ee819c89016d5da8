#include "fitter/effects/effect.h"
#include "fitter/effects/gravity_regressors.h"

namespace armtrue {
namespace {

class JointCompliance final : public Effect {
 public:
  std::string id() const override { return "joint_compliance"; }
  std::string summary() const override { return "one-dimensional torsion spring"; }
  JointRule joint_rule() const override { return JointRule::kEach; }
  std::string bound_text() const override {
    return "0 to 2e-4 rad/Nm: a spring yields; 0.5 to 2.5 urad/Nm on a 30 kg arm, 70 urad/Nm on a "
           "light one (docs/effects.md)";
  }

  std::vector<int> default_joints(const EffectContext& context) const override {
    return gravity_loaded_joints(context);
  }

  EffectTerms build(const EffectContext& context, const EffectRequest& request) const override {
    EffectTerms terms;
    for (const int k : request.joints) {
      const std::string joint = std::to_string(k);
      if (context.state.computes_torque()) {
        Parameter p = single_term(id(), {k}, "", "rad/Nm", kSoftest, motor(k), "tau" + joint);
        p.sign = 1;
        terms.parameters.push_back(p);
      } else {
        append(terms, gravity_regressor_terms(context, id(), {k}, "u_" + joint, "up_" + joint,
                                              motor(k), kSoftest));
      }
    }
    return terms;
  }

  std::vector<EffectRequest> candidates(const EffectContext& context) const override {
    std::vector<EffectRequest> result;
    for (int k = 1; k <= context.joint_count(); ++k) result.push_back({id(), {k}});
    return result;
  }

 private:
  static constexpr double kSoftest = 2e-4;  // [rad/Nm]
};

const RegisterEffect<JointCompliance> registered_joint_compliance;

}  // namespace
}  // namespace armtrue
