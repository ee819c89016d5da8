#include "fitter/effects/effect.h"

namespace armtrue {
namespace {

class ThermalJointDrift final : public Effect {
 public:
  std::string id() const override { return "thermal_joint_drift"; }
  std::string summary() const override { return "joint zero moves with temperature"; }
  JointRule joint_rule() const override { return JointRule::kEach; }
  std::string bound_text() const override { return "2e-4 rad/K, 5e-5 m/K where it slides: ours"; }

  std::vector<EffectOption> options() const override {
    return {{"sensor", "string", "temperature sensor, default the first"}};
  }

  std::vector<std::string> missing(const EffectContext& context,
                                   const std::vector<int>&) const override {
    if (!context.state.sensors().empty()) return {};
    return {"temp_NAME"};
  }

  EffectTerms build(const EffectContext& context, const EffectRequest& request) const override {
    EffectTerms terms;
    for (const int k : request.joints) {
      terms.parameters.push_back(single_term(id(), {k}, "", motor_unit(context, k) + "/K",
                                             on_motor(context, k, 2e-4, 5e-5), motor(k),
                                             temperature_variable(request)));
    }
    return terms;
  }

  std::vector<EffectRequest> candidates(const EffectContext& context) const override {
    std::vector<EffectRequest> result;
    for (const std::string& sensor : context.state.sensors()) {
      for (int k = 1; k <= context.joint_count(); ++k)
        result.push_back({id(), {k}, {{"sensor", sensor}}});
    }
    return result;
  }
};

const RegisterEffect<ThermalJointDrift> registered_thermal_joint_drift;

}  // namespace
}  // namespace armtrue
