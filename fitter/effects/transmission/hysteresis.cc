#include <initializer_list>
#include <numbers>

#include "fitter/effects/effect.h"

namespace armtrue {
namespace {

class Hysteresis final : public Effect {
 public:
  Hysteresis()
      : Effect({.id = "hysteresis",
                .summary = "friction winds the gear up: lost motion with load and history",
                .bound = "1e-3 rad, at the largest load too, against the motion: ours, five times "
                         "what robots' gears wind up",
                .drives = DriveRule::kEach,
                .options =
                    {{"theta0", "rad or m",
                      "travel over which the wind-up changes sides, default found from the data"}},
                .searched = {"theta0"},
                .joint_columns = {"dir", "travel"}}) {}

  // The link lags behind its drive by the wind-up that friction holds, so both coefficients act
  // against the motion.
  EffectTerms build(const EffectContext& context, const EffectRequest& request) const override {
    EffectTerms terms;
    for (const int k : request.joints) {
      const std::string joint = std::to_string(k);
      const std::string dir = "dir" + joint, travel = "travel" + joint, tau = "tau" + joint;
      const std::string theta0 = number_or_unknown(request,
                                                   {"hysteresis_theta0_" + joint,
                                                    id(),
                                                    {k},
                                                    "rad",
                                                    2.0 * kDegree,
                                                    1e-3,
                                                    0.5,
                                                    kTravels,
                                                    "theta0"},
                                                   terms);
      const auto add_lag = [&](const std::string& suffix, const std::string& unit, double bound,
                               const std::string& basis) {
        Parameter& p = add(terms, {k}, suffix, unit, bound, motor(k), basis);
        p.sign = -1;
        p.sign_doubt = kCountedOtherwise;
      };
      const std::string unit = motor_unit(context, k);
      add_lag("travel", unit, kLargest, dir + "*(1 - 2*exp(-" + travel + "/" + theta0 + "))");
      if (!context.state.has(tau) || !carries_gravity(context, k)) continue;
      const double load = largest_of(context, tau);
      if (load > 0.0)
        add_lag("load", unit + (context.prismatic(k) ? "/N" : "/Nm"), kLargest / load,
                dir + "*abs(" + tau + ")");
    }
    return terms;
  }

  std::vector<EffectRequest> candidates(const EffectContext& context) const override {
    std::vector<EffectRequest> result;
    for (int k = 1; k <= context.joint_count(); ++k) {
      for (const double travel : kTravels) result.push_back({id(), {k}, {{"theta0", travel}}});
    }
    return result;
  }

 private:
  static constexpr double kLargest = 1e-3;  // [rad or m]
  static constexpr double kDegree = std::numbers::pi / 180.0;
  static constexpr std::initializer_list<double> kTravels = {0.5 * kDegree, kDegree, 2.0 * kDegree,
                                                             4.0 * kDegree};
};

const RegisterEffect<Hysteresis> registered_hysteresis;

}  // namespace
}  // namespace armtrue
