#include <numbers>

#include "fitter/effects/effect.h"

namespace armtrue {
namespace {

class GravityBalancer final : public Effect {
 public:
  std::string id() const override { return "gravity_balancer"; }
  std::string summary() const override { return "spring or gas cylinder that carries axis 2"; }
  JointRule joint_rule() const override { return JointRule::kFixed; }
  std::string bound_text() const override {
    return "1e-2 rad in all (3e-2 each of rate and preload), against gravity; pivots closer to "
           "the axis than each other: ours";
  }

  std::vector<EffectOption> options() const override {
    return {{"ratio", "number",
             "lever of the moving pivot over that of the fixed one, default found from the data"},
            {"phase", "rad",
             "angle between the two levers where q2 is zero, default found from the data"}};
  }

  std::vector<int> default_joints(const EffectContext&) const override { return {2}; }

  std::vector<std::string> searched_options() const override { return {"ratio", "phase"}; }

  std::optional<CarriedLoad> carries() const override { return CarriedLoad{"tau2", kLargest}; }

  // A spring from a fixed pivot (lever a) to a pivot on link 2 (lever b = ratio * a): with x the
  // angle between the levers, length L = a sqrt(1 + ratio^2 - 2 ratio cos x), torque = a b sin(x)
  // (F / L), F = F0 + k (L - L0). The torque is sin(x) times a constant (the spring's rate) plus
  // sin(x) / L times another (its preload): two linear coefficients.
  EffectTerms build(const EffectContext& context, const EffectRequest& request) const override {
    if (context.joint_count() < 2)
      throw ModelError("effect gravity_balancer: the arm has no joint 2");
    EffectTerms terms;
    const auto value_or_name = [&](const char* option, NonlinearParameter p) {
      if (request.options.contains(option)) {
        return Expression::number(request.options[option].get<double>()).to_string();
      }
      p.option = option;
      terms.nonlinear.push_back(p);
      return p.name;
    };
    const double pi = std::numbers::pi;
    std::vector<double> phases;
    for (int step = 0; step < kStartPhases; ++step)
      phases.push_back((2.0 * step / kStartPhases - 1.0) * pi);
    const std::string ratio = value_or_name(
        "ratio",
        {"gravity_balancer_ratio", id(), {2}, "1", 0.4, 0.05, 0.98, {0.1, 0.25, 0.4, 0.6, 0.85}});
    const std::string phase = value_or_name(
        "phase", {"gravity_balancer_phase", id(), {2}, "rad", 0.0, -2 * pi, 2 * pi, phases});
    const std::string x = "(q2 + " + phase + ")";
    terms.parameters.push_back(
        single_term(id(), {2}, "rate", "rad", kLargestPart, motor(2), "sin" + x));
    terms.parameters.push_back(
        single_term(id(), {2}, "preload", "rad", kLargestPart, motor(2),
                    "sin" + x + "/sqrt(1 + " + ratio + "^2 - 2*" + ratio + "*cos" + x + ")"));
    return terms;
  }

  std::vector<EffectRequest> candidates(const EffectContext& context) const override {
    std::vector<EffectRequest> result;
    if (context.joint_count() < 2 || context.prismatic(2) || !carries_gravity(context, 2))
      return result;
    for (const double ratio : {0.1, 0.25, 0.4, 0.6, 0.85}) {
      for (int step = 0; step < kPhases; ++step) {
        result.push_back(
            {id(),
             {2},
             {{"ratio", ratio}, {"phase", (2.0 * step / kPhases - 1.0) * std::numbers::pi}}});
      }
    }
    return result;
  }

 private:
  static constexpr double kLargest = 1e-2;  // [rad], in all
  static constexpr double kLargestPart =
      3e-2;  // of rate and preload, which work against each other
  static constexpr int kPhases = 12;
  // A fit, unlike the search, has no other candidates that lead it to a minimum, and some minima
  // are only a quarter of a radian wide.
  static constexpr int kStartPhases = 24;
};

const RegisterEffect<GravityBalancer> registered_gravity_balancer;

}  // namespace
}  // namespace armtrue
