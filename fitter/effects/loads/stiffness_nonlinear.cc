#include <algorithm>
#include <array>
#include <cmath>

#include "fitter/effects/effect.h"

namespace armtrue {
namespace {

class StiffnessNonlinear final : public Effect {
 public:
  StiffnessNonlinear()
      : Effect({.id = "stiffness_nonlinear",
                .summary = "hardening spring (strain-wave gear)",
                .bound = "5e-3 rad (1 mm where it slides) at the largest load in the data, each; "
                         "the square only hardens: ours, half of what a spring may yield; a soft "
                         "zone gives way by 0 to 2e-3 rad (0.4 mm): ours, twice the lost motion "
                         "that gears are sold with",
                .drives = DriveRule::kEach,
                .options = {{"soft", "bool",
                             "with a zone about zero load in which the gear is softer"},
                            {"soft_torque", "Nm",
                             "load at which that zone ends, default found from the data"}},
                .searched = {"soft_torque"}}) {}

  std::vector<int> default_joints(const EffectContext& context) const override {
    return gravity_loaded_joints(context);
  }

  std::vector<std::string> missing(const EffectContext& context,
                                   const std::vector<int>& joints) const override {
    std::vector<std::string> lacking;
    for (const int k : joints) {
      if (!context.state.has("tau" + std::to_string(k)))
        lacking.push_back("tau" + std::to_string(k) + " or link masses");
    }
    return lacking;
  }

  EffectTerms build(const EffectContext& context, const EffectRequest& request) const override {
    EffectTerms terms;
    for (const int k : request.joints) {
      const std::string tau = "tau" + std::to_string(k);
      const std::string per = motor_unit(context, k) + (context.prismatic(k) ? "/N" : "/Nm");
      const double load = std::max(largest_of(context, tau), kLeastLoad);
      const double most = on_motor(context, k, kLargest, kFurthest);
      // A wound-up gear engages more of its teeth, so it becomes stiffer.
      add(terms, {k}, "square", per + "^2", most / std::pow(load, 2), motor(k),
          tau + "*abs(" + tau + ")")
          .sign = -1;
      add(terms, {k}, "cube", per + "^3", most / std::pow(load, 3), motor(k), tau + "^3");
      if (!request.options.value("soft", false)) continue;
      std::vector<double> starts;
      for (const double share : kSoftShares) starts.push_back(share * load);
      const std::string end =
          number_or_unknown(request,
                            {"stiffness_nonlinear_soft_torque_" + std::to_string(k),
                             id(),
                             {k},
                             "Nm",
                             starts.front(),
                             0.01 * load,
                             0.5 * load,
                             starts,
                             "soft_torque"},
                            terms);
      add(terms, {k}, "soft", motor_unit(context, k), on_motor(context, k, kSoftest, kSoftestSlide),
          motor(k),
          "tanh(" + tau + "/" + end + ")")
          .sign = 1;  // it yields to the load
    }
    return terms;
  }

  std::vector<EffectRequest> candidates(const EffectContext& context) const override {
    std::vector<EffectRequest> result = Effect::candidates(context);
    for (const int k : default_joints(context)) {
      const std::string tau = "tau" + std::to_string(k);
      if (!context.state.has(tau)) continue;
      const double load = largest_of(context, tau);
      for (const double share : kSoftShares)
        result.push_back({id(), {k}, {{"soft", true}, {"soft_torque", share * load}}});
    }
    return result;
  }

 private:
  // A joint with a soft zone is more compliant at small loads. The diagnosis tries zones that end
  // at these shares of the largest load in the data.
  static constexpr std::array<double, 4> kSoftShares = {0.03, 0.06, 0.12, 0.25};
  static constexpr double kSoftest = 2e-3, kSoftestSlide = 4e-4;  // [rad], [m]
  static constexpr double kLargest = 5e-3, kFurthest = 1e-3;      // [rad], [m]
  static constexpr double kLeastLoad = 1.0;                       // [Nm or N]
};

const RegisterEffect<StiffnessNonlinear> registered_stiffness_nonlinear;

}  // namespace
}  // namespace armtrue
