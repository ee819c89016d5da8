#include <numeric>

#include "fitter/effects/effect.h"
#include "fitter/effects/heat/lengths.h"

namespace armtrue {
namespace {

class ThermalExpansion final : public Effect {
 public:
  std::string id() const override { return "thermal_expansion"; }
  std::string summary() const override { return "links grow: dL = alpha L dT"; }
  JointRule joint_rule() const override { return JointRule::kAll; }
  std::string bound_text() const override {
    return "-5e-6 to 5e-5 per K: steel 11.7e-6, aluminium 23.6e-6";
  }

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
    const std::string dT = temperature_variable(request);
    const int n = context.joint_count();
    if (static_cast<int>(request.joints.size()) == n) {
      std::vector<int> links(static_cast<std::size_t>(n) + 1);
      std::iota(links.begin(), links.end(), 0);
      terms.parameters.push_back(
          grown_lengths(context.robot(), id(), {}, "alpha", "1/K", kLargest, links, dT));
      return terms;
    }
    for (const int k : request.joints) {
      terms.parameters.push_back(grown_lengths(context.robot(), id(), {k}, "alpha", "1/K", kLargest,
                                               links_of_joint(k), dT));
    }
    return terms;
  }

  std::vector<EffectRequest> candidates(const EffectContext& context) const override {
    std::vector<EffectRequest> result;
    for (const std::string& sensor : context.state.sensors()) {
      result.push_back({id(), default_joints(context), {{"sensor", sensor}}});
      for (int k = 1; k <= context.joint_count(); ++k)
        result.push_back({id(), {k}, {{"sensor", sensor}}});
    }
    return result;
  }

 private:
  static constexpr double kLargest = 5e-5;  // [1/K]
};

const RegisterEffect<ThermalExpansion> registered_thermal_expansion;

}  // namespace
}  // namespace armtrue
