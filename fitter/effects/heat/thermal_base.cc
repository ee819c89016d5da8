#include "fitter/effects/effect.h"

namespace armtrue {
namespace {

class ThermalBase final : public Effect {
 public:
  std::string id() const override { return "thermal_base"; }
  std::string summary() const override { return "stand or pedestal warps with temperature"; }
  JointRule joint_rule() const override { return JointRule::kNone; }
  std::string bound_text() const override { return "1e-4 m/K, 1e-4 rad/K: ours"; }

  std::vector<EffectOption> options() const override {
    return {{"sensor", "string", "temperature sensor, default the first"}};
  }

  std::vector<std::string> missing(const EffectContext& context,
                                   const std::vector<int>&) const override {
    if (!context.state.sensors().empty()) return {};
    return {"temp_NAME"};
  }

  EffectTerms build(const EffectContext&, const EffectRequest& request) const override {
    EffectTerms terms;
    for (int c = 0; c < 6; ++c) {
      terms.parameters.push_back(single_term(id(), {}, kComponentNames[c], c < 3 ? "m/K" : "rad/K",
                                             1e-4, on_base(c), temperature_variable(request)));
    }
    return terms;
  }

  std::vector<EffectRequest> candidates(const EffectContext& context) const override {
    std::vector<EffectRequest> result;
    for (const std::string& sensor : context.state.sensors())
      result.push_back({id(), {}, {{"sensor", sensor}}});
    return result;
  }
};

const RegisterEffect<ThermalBase> registered_thermal_base;

}  // namespace
}  // namespace armtrue
