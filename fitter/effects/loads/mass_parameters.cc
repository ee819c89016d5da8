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
  std::string id() const override { return "mass_parameters"; }
  std::string summary() const override {
    return "masses, centres of mass or the payload's centre are not as stated";
  }
  double relative_odds() const override { return kOnMostArms; }
  std::string bound_text() const override {
    return "each mass by itself, each centre by 0.1 m: ours, data sheets are 20 % and 15 mm off";
  }

  EffectTerms build(const EffectContext& context, const EffectRequest&) const override {
    EffectTerms terms;
    const auto add = [&](Parameter p) {
      if (!p.terms.empty()) terms.parameters.push_back(std::move(p));
    };
    const int n = context.joint_count();
    for (int link = 1; link <= n; ++link) {
      const Link& stated = context.robot().links[static_cast<std::size_t>(link - 1)];
      if (!(stated.mass > 0.0)) continue;
      const auto add_one = [&](const std::string& component, const char* unit, double furthest,
                               double usual) {
        add(load_change(context, id(), "link" + std::to_string(link) + "_" + component, unit,
                        stated.mass * furthest, stated.mass * usual,
                        [&](const Variable& load) { return regressor(load, link, component); }));
      };
      add_one("m", "kg", 1.0, kUsualShare);
      // A first moment has the error of its centre and that of its mass.
      for (int axis = 0; axis < 3; ++axis) {
        const double arm = std::abs(stated.com_in_frame[axis]);
        add_one({"xyz"[axis]}, "kg m", kFurthest + arm, std::hypot(kUsualShift, kUsualShare * arm));
      }
    }
    if (context.state.recorded("payload")) {
      for (const std::string component : {"x", "y", "z"}) {
        add(load_change(
            context, id(), "payload_" + component, "m", kFurthest, kUsualShift,
            [&](const Variable& load) { return "payload*" + regressor(load, n, component); }));
      }
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
