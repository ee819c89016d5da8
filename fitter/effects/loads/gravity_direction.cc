#include "fitter/effects/loads/spring_loads.h"

namespace armtrue {
namespace {

class GravityDirection final : public LoadEffect {
 public:
  GravityDirection()
      : LoadEffect({.id = "gravity_direction",
                    .summary = "robot base is not level",
                    .bound = "5e-2 rad: ours, a floor that slopes by 3 degrees is seen by eye",
                    .relative_odds = kOnMostArms}) {}

  EffectTerms build(const EffectContext& context, const EffectRequest&) const override {
    EffectTerms terms;
    for (const std::string about : {"x", "y"}) {
      const auto change = [&](const Variable& load) {
        const std::string of =
            load.kind == VariableKind::kTorque ? "tilt_" : (load.axis == 0 ? "tiltx_" : "tilty_");
        return of + std::to_string(load.joint) + "_" + about;
      };
      add_change(context, "r" + about, "rad", kLargest, kUsual, change, terms);
    }
    return terms;
  }

 private:
  static constexpr double kLargest = 5e-2;  // [rad]
  static constexpr double kUsual = 3e-3;    // [rad]
};

const RegisterEffect<GravityDirection> registered_gravity_direction;

}  // namespace
}  // namespace armtrue
