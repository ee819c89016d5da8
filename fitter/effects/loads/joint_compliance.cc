#include "fitter/effects/effect.h"
#include "fitter/effects/loads/gravity_regressors.h"

namespace armtrue {
namespace {

class JointCompliance final : public Effect {
 public:
  std::string id() const override { return "joint_compliance"; }
  std::string summary() const override { return "one-dimensional torsion spring"; }
  JointRule joint_rule() const override { return JointRule::kEach; }
  std::string bound_text() const override {
    return "0 to 1e-2 rad (3 mm where it slides) under the largest load in the data, at most 1e-3 "
           "rad/Nm (1e-5 m/N; 2e-4 rad/Nm where nobody knows the loads): ours, a spring yields; "
           "light arms sag by 3 mrad, heavy ones by 1";
  }

  std::vector<int> default_joints(const EffectContext& context) const override {
    return gravity_loaded_joints(context);
  }

  EffectTerms build(const EffectContext& context, const EffectRequest& request) const override {
    EffectTerms terms;
    for (const int k : request.joints) {
      const std::string joint = std::to_string(k);
      if (context.state.computes_torque()) {
        const double bound = context.prismatic(k)
                                 ? softest(context, "tau" + joint, kFurthest, kLoosest)
                                 : softest(context, "tau" + joint, kLargest, kSoftest);
        Parameter p = single_term(id(), {k}, "", context.prismatic(k) ? "m/N" : "rad/Nm", bound,
                                  motor(k), "tau" + joint);
        p.sign = 1;
        terms.parameters.push_back(p);
      } else {
        append(terms, gravity_regressor_terms(context, id(), {k}, "u_" + joint, "up_" + joint,
                                              motor(k), kUnknown));
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
  static constexpr double kLargest = 1e-2;  // [rad], three times the sag of light arms
  static constexpr double kSoftest = 1e-3;  // [rad/Nm], four times that of a small strain-wave gear
  static constexpr double kFurthest = 3e-3, kLoosest = 1e-5;  // [m], [m/N]
  static constexpr double kUnknown = 2e-4;                    // [rad/Nm] if the loads are unknown
};

const RegisterEffect<JointCompliance> registered_joint_compliance;

}  // namespace
}  // namespace armtrue
