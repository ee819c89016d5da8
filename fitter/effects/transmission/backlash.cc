#include <algorithm>

#include "fitter/effects/effect.h"

namespace armtrue {
namespace {

class Backlash final : public Effect {
 public:
  Backlash()
      : Effect({.id = "backlash",
                .summary =
                    "lost motion: direction of approach, and side of the gap that gravity takes",
                .bound = "3e-3 rad (5e-4 m where it slides), the link lags behind its drive and "
                         "falls with its load: 3 to 60 arcsec are usual",
                .drives = DriveRule::kEach,
                .joint_columns = {"dir"}}) {}

  EffectTerms build(const EffectContext& context, const EffectRequest& request) const override {
    EffectTerms terms;
    for (const int k : request.joints) {
      const std::string joint = std::to_string(k);
      const std::string tau = "tau" + joint;
      const std::string unit = motor_unit(context, k);
      const double bound = on_motor(context, k, kLargest, kFurthest);
      const auto add_lag = [&](const std::string& suffix, const std::string& basis, int sign) {
        Parameter& p = add(terms, {k}, suffix, unit, bound, motor(k), basis);
        p.sign = sign;
        p.sign_doubt = kCountedOtherwise;
      };
      add_lag("direction", "dir" + joint, -1);
      if (context.state.has(tau) && loaded(context, k)) add_lag("load", "sign(" + tau + ")", 1);
    }
    return terms;
  }

 private:
  static constexpr double kLargest = 3e-3, kFurthest = 5e-4;  // [rad], [m]

  // With an axis along gravity, no side of the gap is loaded: the torque is rounding error and its
  // sign noise.
  static bool loaded(const EffectContext& context, int joint) {
    double largest = 0.0;
    for (int k = 1; k <= context.joint_count(); ++k) {
      const std::string tau = "tau" + std::to_string(k);
      if (context.state.has(tau)) largest = std::max(largest, largest_of(context, tau));
    }
    return largest_of(context, "tau" + std::to_string(joint)) > 1e-4 * largest;
  }
};

const RegisterEffect<Backlash> registered_backlash;

}  // namespace
}  // namespace armtrue
