#include <cmath>

#include "fitter/effects/loads/spring_loads.h"

namespace armtrue {
namespace {

// The regressor that is the derivative of a load by a component of a link's mass; empty if the link
// lies before the joint.
std::string regressor(const Variable& load, int link, const std::string& component) {
  if (link < load.joint) return "";
  const std::string of =
      load.kind == VariableKind::kTorque ? "u_" : (load.axis == 0 ? "ux_" : "uy_");
  return of + std::to_string(load.joint) + "_" + std::to_string(link) + "_" + component;
}

class MassParameters final : public LoadEffect {
 public:
  MassParameters()
      : LoadEffect({.id = "mass_parameters",
                    .summary = "masses, centres of mass or the payload's centre are not as stated",
                    .bound = "each mass by itself, each centre by 0.1 m: ours, data sheets are 20 "
                             "% and 15 mm off",
                    .relative_odds = kOnMostArms}) {}

  EffectTerms build(const EffectContext& context, const EffectRequest&) const override {
    EffectTerms terms;
    const int n = context.joint_count();
    for (int link = 1; link <= n; ++link) {
      const Link& stated = context.robot().links[static_cast<std::size_t>(link - 1)];
      if (!(stated.mass > 0.0)) continue;
      const auto add = [&](const std::string& component, const char* unit, double furthest,
                           double usual) {
        add_change(
            context, "link" + std::to_string(link) + "_" + component, unit, stated.mass * furthest,
            stated.mass * usual,
            [&](const Variable& load) { return regressor(load, link, component); }, terms);
      };
      add("m", "kg", 1.0, kUsualShare);
      // A first moment has the error of its centre and that of its mass.
      for (int axis = 0; axis < 3; ++axis) {
        const double arm = std::abs(stated.com_in_frame[axis]);
        add({"xyz"[axis]}, "kg m", kFurthest + arm, std::hypot(kUsualShift, kUsualShare * arm));
      }
    }
    if (!context.state.recorded("payload")) return terms;
    for (const std::string component : {"x", "y", "z"}) {
      add_change(
          context, "payload_" + component, "m", kFurthest, kUsualShift,
          [&](const Variable& load) { return "payload*" + regressor(load, n, component); }, terms);
    }
    return terms;
  }

 private:
  static constexpr double kFurthest = 0.1;      // [m]
  static constexpr double kUsualShare = 0.2;    // of a mass
  static constexpr double kUsualShift = 0.015;  // [m] of a centre
};

const RegisterEffect<MassParameters> registered_mass_parameters;

}  // namespace
}  // namespace armtrue
