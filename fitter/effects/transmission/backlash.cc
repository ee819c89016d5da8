#include <algorithm>
#include <cmath>

#include "fitter/effects/effect.h"

namespace armtrue {
namespace {

class Backlash final : public Effect {
 public:
  std::string id() const override { return "backlash"; }
  std::string summary() const override {
    return "lost motion: direction of approach, and side of the gap that gravity takes";
  }
  JointRule joint_rule() const override { return JointRule::kEach; }
  DriveRule drive_rule() const override { return DriveRule::kEach; }
  std::string bound_text() const override {
    return "3e-3 rad (5e-4 m where it slides), the link lags behind its drive and falls with its "
           "load: 3 to 60 arcsec are usual";
  }

  std::vector<std::string> missing(const EffectContext& context,
                                   const std::vector<int>& joints) const override {
    std::vector<std::string> lacking;
    for (const int k : joints) {
      if (!context.state.has("dir" + std::to_string(k)))
        lacking.push_back("dir" + std::to_string(k));
    }
    return lacking;
  }

  EffectTerms build(const EffectContext& context, const EffectRequest& request) const override {
    EffectTerms terms;
    for (const int k : request.joints) {
      const std::string joint = std::to_string(k);
      const std::string tau = "tau" + joint;
      const std::string unit = motor_unit(context, k);
      const double bound = on_motor(context, k, kLargest, kFurthest);
      terms.parameters.push_back(
          single_term(id(), {k}, "direction", unit, bound, motor(k), "dir" + joint));
      terms.parameters.back().sign = -1;
      terms.parameters.back().sign_doubt = kCountedOtherwise;
      if (context.state.has(tau) && loaded(context, k)) {
        terms.parameters.push_back(
            single_term(id(), {k}, "load", unit, bound, motor(k), "sign(" + tau + ")"));
        terms.parameters.back().sign = 1;
        terms.parameters.back().sign_doubt = kCountedOtherwise;
      }
    }
    return terms;
  }

 private:
  static constexpr double kLargest = 3e-3, kFurthest = 5e-4;  // [rad], [m]

  // With an axis along gravity, no side of the gap is loaded: the torque is rounding error and its
  // sign noise.
  static bool loaded(const EffectContext& context, int joint) {
    const auto size = [&](int k) {
      double largest = 0.0;
      for (const double v : context.state.column("tau" + std::to_string(k)))
        largest = std::max(largest, std::abs(v));
      return largest;
    };
    double largest = 0.0;
    for (int k = 1; k <= context.joint_count(); ++k) {
      if (context.state.has("tau" + std::to_string(k))) largest = std::max(largest, size(k));
    }
    return size(joint) > 1e-4 * largest;
  }
};

const RegisterEffect<Backlash> registered_backlash;

}  // namespace
}  // namespace armtrue
