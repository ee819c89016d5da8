#include <initializer_list>
#include <numbers>

#include "fitter/effects/effect.h"

namespace armtrue {
namespace {

constexpr double kDegreeOfTravel = std::numbers::pi / 180.0;

class Hysteresis final : public Effect {
 public:
  std::string id() const override { return "hysteresis"; }
  std::string summary() const override {
    return "friction winds the gear up: lost motion with load and history";
  }
  JointRule joint_rule() const override { return JointRule::kEach; }
  DriveRule drive_rule() const override { return DriveRule::kEach; }
  std::string bound_text() const override {
    return "1e-3 rad, at the largest load too, against the motion: ours, five times what robots' "
           "gears wind up";
  }

  std::vector<EffectOption> options() const override {
    return {{"theta0", "rad or m",
             "travel over which the wind-up changes sides, default found from the data"}};
  }
  std::vector<std::string> searched_options() const override { return {"theta0"}; }

  std::vector<std::string> missing(const EffectContext& context,
                                   const std::vector<int>& joints) const override {
    std::vector<std::string> lacking;
    for (const int k : joints) {
      for (const char* stem : {"dir", "travel"}) {
        const std::string column = stem + std::to_string(k);
        if (!context.state.has(column)) lacking.push_back(column);
      }
    }
    return lacking;
  }

  // The link lags behind its drive by the wind-up that friction holds, so both coefficients act
  // against the motion.
  EffectTerms build(const EffectContext& context, const EffectRequest& request) const override {
    EffectTerms terms;
    for (const int k : request.joints) {
      const std::string joint = std::to_string(k);
      const std::string dir = "dir" + joint, travel = "travel" + joint, tau = "tau" + joint;
      const std::string theta0 = turn_round(request, k, terms);
      const auto add = [&](const std::string& suffix, const std::string& unit, double bound,
                           const std::string& basis) {
        Parameter p = single_term(id(), {k}, suffix, unit, bound, motor(k), basis);
        p.sign = -1;
        p.sign_doubt = kCountedOtherwise;
        terms.parameters.push_back(p);
      };
      const std::string unit = motor_unit(context, k);
      add("travel", unit, kLargest, dir + "*(1 - 2*exp(-" + travel + "/" + theta0 + "))");
      if (!context.state.has(tau) || !carries_gravity(context, k)) continue;
      const double load = largest_of(context, tau);
      if (load > 0.0)
        add("load", unit + (context.prismatic(k) ? "/N" : "/Nm"), kLargest / load,
            dir + "*abs(" + tau + ")");
    }
    return terms;
  }

  std::vector<EffectRequest> candidates(const EffectContext& context) const override {
    std::vector<EffectRequest> result;
    for (int k = 1; k <= context.joint_count(); ++k) {
      for (const double degrees : kTravels)
        result.push_back({id(), {k}, {{"theta0", degrees * kDegreeOfTravel}}});
    }
    return result;
  }

 private:
  static constexpr double kLargest = 1e-3;  // [rad or m]
  static constexpr std::initializer_list<double> kTravels = {0.5, 1.0, 2.0, 4.0};

  std::string turn_round(const EffectRequest& request, int joint, EffectTerms& terms) const {
    if (request.options.contains("theta0"))
      return Expression::number(request.options["theta0"].get<double>()).to_string();
    NonlinearParameter p{"hysteresis_theta0_" + std::to_string(joint),
                         id(),
                         {joint},
                         "rad",
                         2.0 * kDegreeOfTravel,
                         1e-3,
                         0.5,
                         {},
                         "theta0"};
    for (const double degrees : kTravels) p.starts.push_back(degrees * kDegreeOfTravel);
    terms.nonlinear.push_back(p);
    return p.name;
  }
};

const RegisterEffect<Hysteresis> registered_hysteresis;

}  // namespace
}  // namespace armtrue
