#include "fitter/effects/effect.h"

namespace armtrue {
namespace {

class ThermalGradient final : public Effect {
 public:
  ThermalGradient()
      : Effect({.id = "thermal_gradient",
                .summary = "one side of a link is warmer, and the link bends",
                .bound = "3e-4 rad/K: ours, an aluminium link twelve times as long as it is thick "
                         "bends by alpha L / h",
                .options = {{"sensors", "[string]",
                             "the two whose difference counts, default the last two"}}}) {}

  std::vector<std::string> missing(const EffectContext& context,
                                   const std::vector<int>&) const override {
    if (context.state.sensors().size() > 1) return {};
    return {"two columns temp_NAME, one on either side of a link"};
  }

  EffectTerms build(const EffectContext& context, const EffectRequest& request) const override {
    const std::vector<std::string>& known = context.state.sensors();
    const std::vector<std::string> pair = request.options.value(
        "sensors", std::vector<std::string>{known[known.size() - 2], known.back()});
    if (pair.size() != 2) {
      throw ModelError("effect thermal_gradient: found " + std::to_string(pair.size()) +
                       " sensors, expected two");
    }
    EffectTerms terms;
    for (const int k : request.joints) {
      for (int c = 3; c < 5; ++c) {
        add(terms, {k}, kComponentNames[c], "rad/K", kLargest, on_link(k, c),
            "dT_" + pair[0] + " - dT_" + pair[1]);
      }
    }
    return terms;
  }

  std::vector<EffectRequest> candidates(const EffectContext& context) const override {
    const std::vector<std::string>& sensors = context.state.sensors();
    std::vector<EffectRequest> result;
    for (int k = 1; k <= context.joint_count(); ++k) {
      for (std::size_t a = 0; a < sensors.size(); ++a) {
        for (std::size_t b = a + 1; b < sensors.size(); ++b)
          result.push_back({id(), {k}, {{"sensors", {sensors[a], sensors[b]}}}});
      }
    }
    return result;
  }

 private:
  static constexpr double kLargest = 3e-4;  // [rad/K]
};

const RegisterEffect<ThermalGradient> registered_thermal_gradient;

}  // namespace
}  // namespace armtrue
