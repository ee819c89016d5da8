#include <initializer_list>
#include <numbers>

#include "fitter/effects/effect.h"

namespace armtrue {
namespace {

class GravityBalancer final : public Effect {
 public:
  GravityBalancer()
      : Effect(
            {.id = "gravity_balancer",
             .summary = "spring or gas cylinder that carries axis 2",
             .bound = "1e-2 rad in all (3e-2 each of rate and preload), against gravity; pivots "
                      "closer to the axis than each other: ours",
             .joints = JointRule::kFixed,
             .options =
                 {{"ratio", "number",
                   "lever of the moving pivot over that of the fixed one, default found from the "
                   "data"},
                  {"phase", "rad",
                   "angle between the two levers where q2 is zero, default found from the data"}},
             .searched = {"ratio", "phase"}}) {}

  std::vector<int> default_joints(const EffectContext&) const override { return {2}; }

  std::optional<CarriedLoad> carries() const override { return CarriedLoad{"tau2", kLargest}; }

  // A spring from a fixed pivot (lever a) to a pivot on link 2 (lever b = ratio * a): with x the
  // angle between the levers, length L = a sqrt(1 + ratio^2 - 2 ratio cos x), torque = a b sin(x)
  // (F / L), F = F0 + k (L - L0). The torque is sin(x) times a constant (the spring's rate) plus
  // sin(x) / L times another (its preload): two linear coefficients.
  EffectTerms build(const EffectContext& context, const EffectRequest& request) const override {
    if (context.joint_count() < 2)
      throw ModelError("effect gravity_balancer: the arm has no joint 2");
    EffectTerms terms;
    const double turn = 2.0 * std::numbers::pi;
    const std::string ratio = number_or_unknown(
        request, {"gravity_balancer_ratio", id(), {2}, "1", 0.4, 0.05, 0.98, kRatios, "ratio"},
        terms);
    const std::string phase = number_or_unknown(request,
                                                {"gravity_balancer_phase",
                                                 id(),
                                                 {2},
                                                 "rad",
                                                 0.0,
                                                 -turn,
                                                 turn,
                                                 phases(kStartPhases),
                                                 "phase"},
                                                terms);
    const std::string x = "(q2 + " + phase + ")";
    const auto add_part = [&](const std::string& suffix, const std::string& basis) {
      add(terms, {2}, suffix, "rad", kLargestPart, motor(2), basis);
    };
    add_part("rate", "sin" + x);
    add_part("preload", "sin" + x + "/sqrt(1 + " + ratio + "^2 - 2*" + ratio + "*cos" + x + ")");
    return terms;
  }

  std::vector<EffectRequest> candidates(const EffectContext& context) const override {
    std::vector<EffectRequest> result;
    if (context.joint_count() < 2 || context.prismatic(2) || !carries_gravity(context, 2))
      return result;
    for (const double ratio : kRatios) {
      for (const double phase : phases(kPhases))
        result.push_back({id(), {2}, {{"ratio", ratio}, {"phase", phase}}});
    }
    return result;
  }

 private:
  static constexpr double kLargest = 1e-2;  // [rad], in all
  static constexpr double kLargestPart =
      3e-2;  // of rate and preload, which work against each other
  static constexpr std::initializer_list<double> kRatios = {0.1, 0.25, 0.4, 0.6, 0.85};
  static constexpr int kPhases = 12;
  // A fit, unlike the search, has no other candidates that lead it to a minimum, and some minima
  // are only a quarter of a radian wide.
  static constexpr int kStartPhases = 24;

  // So many phases, evenly over a turn.
  static std::vector<double> phases(int count) {
    std::vector<double> result;
    for (int step = 0; step < count; ++step)
      result.push_back((2.0 * step / count - 1.0) * std::numbers::pi);
    return result;
  }
};

const RegisterEffect<GravityBalancer> registered_gravity_balancer;

}  // namespace
}  // namespace armtrue
