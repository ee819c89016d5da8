#include "fitter/effects/effect.h"
#include "fitter/effects/loads/gravity_regressors.h"

namespace armtrue {
namespace {

class JointCompliance final : public Effect {
 public:
  JointCompliance()
      : Effect({.id = "joint_compliance",
                .summary = "one-dimensional torsion spring",
                .bound =
                    "0 to 1e-2 rad (3 mm where it slides) under the largest load in the data, at "
                    "most 1e-3 rad/Nm (1e-5 m/N; 2e-4 rad/Nm where nobody knows the loads): "
                    "ours, a spring yields; light arms sag by 3 mrad, heavy ones by 1"}) {}

  std::vector<int> default_joints(const EffectContext& context) const override {
    return gravity_loaded_joints(context);
  }

  EffectTerms build(const EffectContext& context, const EffectRequest& request) const override {
    EffectTerms terms;
    for (const int k : request.joints) {
      const std::string joint = std::to_string(k);
      if (context.state.computes_torque()) {
        const double bound =
            softest(context, "tau" + joint, on_motor(context, k, kLargest, kFurthest),
                    on_motor(context, k, kSoftest, kLoosest));
        add(terms, {k}, "", context.prismatic(k) ? "m/N" : "rad/Nm", bound, motor(k), "tau" + joint)
            .sign = 1;
      } else {
        add_gravity_regressors(context, *this, {k}, "_" + joint, motor(k), kUnknown, "", terms);
      }
    }
    return terms;
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
