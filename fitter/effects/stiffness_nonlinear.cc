#include "fitter/effects/effect.h"

namespace armtrue {
namespace {

class StiffnessNonlinear final : public Effect {
 public:
  std::string id() const override { return "stiffness_nonlinear"; }
  std::string summary() const override { return "hardening spring (strain-wave gear)"; }
  JointRule joint_rule() const override { return JointRule::kEach; }
  std::string bound_text() const override {
    return "30 % of a soft joint's deflection at 200 Nm: 1.5e-7 rad/Nm^2, 1e-9 rad/Nm^3 "
           "(docs/effects.md)";
  }

  std::vector<int> default_joints(const EffectContext& context) const override {
    return gravity_loaded_joints(context);
  }

  std::vector<std::string> missing(const EffectContext& context,
                                   const std::vector<int>& joints) const override {
    std::vector<std::string> lacking;
    for (const int k : joints) {
      if (!context.state.has("tau" + std::to_string(k)))
        lacking.push_back("tau" + std::to_string(k) + " or link masses");
    }
    return lacking;
  }

  EffectTerms build(const EffectContext&, const EffectRequest& request) const override {
    EffectTerms terms;
    for (const int k : request.joints) {
      const std::string tau = "tau" + std::to_string(k);
      terms.parameters.push_back(
          single_term(id(), {k}, "square", "rad/Nm^2", 1e-6, motor(k), tau + "*abs(" + tau + ")"));
      terms.parameters.push_back(
          single_term(id(), {k}, "cube", "rad/Nm^3", 1e-8, motor(k), tau + "^3"));
    }
    return terms;
  }

  std::vector<EffectRequest> candidates(const EffectContext& context) const override {
    std::vector<EffectRequest> result;
    for (int k = 1; k <= context.joint_count(); ++k) result.push_back({id(), {k}});
    return result;
  }
};

const RegisterEffect<StiffnessNonlinear> registered_stiffness_nonlinear;

}  // namespace
}  // namespace armtrue
