#include "fitter/effects/loads/spring_loads.h"

namespace armtrue {
namespace {

class GravityDirection final : public LoadEffect {
 public:
  std::string id() const override { return "gravity_direction"; }
  std::string summary() const override { return "robot base is not level"; }
  double relative_odds() const override { return kOnMostArms; }
  std::string bound_text() const override {
    return "5e-2 rad: ours, a floor that slopes by 3 degrees is seen by eye";
  }

  EffectTerms build(const EffectContext& context, const EffectRequest&) const override {
    EffectTerms terms;
    for (const std::string about : {"x", "y"}) {
      Parameter p = load_change(
          context, id(), "r" + about, "rad", kLargest, kUsual, [&](const Variable& load) {
            const std::string of = load.kind == VariableKind::kTorque
                                       ? "tilt_"
                                       : (load.axis == 0 ? "tiltx_" : "tilty_");
            return of + std::to_string(load.joint) + "_" + about;
          });
      if (!p.terms.empty()) terms.parameters.push_back(std::move(p));
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
