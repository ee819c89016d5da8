#include "fitter/effects/effect.h"
#include "fitter/effects/heat/lengths.h"

namespace armtrue {
namespace {

class ThermalExpansion final : public Effect {
 public:
  ThermalExpansion()
      : Effect({.id = "thermal_expansion",
                .summary = "links grow: dL = alpha L dT",
                .bound = "-5e-6 to 5e-5 per K: steel 11.7e-6, aluminium 23.6e-6",
                .joints = JointRule::kAll,
                .by_sensor = true}) {}

  EffectTerms build(const EffectContext& context, const EffectRequest& request) const override {
    EffectTerms terms;
    const std::string dT = temperature_variable(request);
    const auto grow = [&](const std::vector<int>& joints, int first, int last) {
      grown_lengths(context, *this, joints, "alpha", "1/K", kLargest, first, last, dT, terms);
    };
    if (static_cast<int>(request.joints.size()) == context.joint_count()) {
      grow({}, 0, context.joint_count());
    } else {
      // The length before joint 1 is the base's.
      for (const int k : request.joints) grow({k}, k == 1 ? 0 : k, k);
    }
    return terms;
  }

 private:
  static constexpr double kLargest = 5e-5;  // [1/K]
};

const RegisterEffect<ThermalExpansion> registered_thermal_expansion;

}  // namespace
}  // namespace armtrue
