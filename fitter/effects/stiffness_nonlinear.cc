#include <algorithm>
#include <cmath>

#include "fitter/effects/effect.h"

namespace armtrue {
namespace {

class StiffnessNonlinear final : public Effect {
 public:
  std::string id() const override { return "stiffness_nonlinear"; }
  std::string summary() const override { return "hardening spring (strain-wave gear)"; }
  JointRule joint_rule() const override { return JointRule::kEach; }
  std::string bound_text() const override {
    return "5e-3 rad (1 mm where it slides) at the largest load in the data, each; the square only "
           "hardens: ours, half of what a spring may yield (docs/effects.md)";
  }

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
      // A gear that is wound up engages more of its teeth: it hardens.
      Parameter square = single_term(id(), {k}, "square", per + "^2", most / std::pow(load, 2),
                                     motor(k), tau + "*abs(" + tau + ")");
      square.sign = -1;
      terms.parameters.push_back(square);
      terms.parameters.push_back(single_term(id(), {k}, "cube", per + "^3",
                                             most / std::pow(load, 3), motor(k), tau + "^3"));
    }
    return terms;
  }

  std::vector<EffectRequest> candidates(const EffectContext& context) const override {
    std::vector<EffectRequest> result;
    for (int k = 1; k <= context.joint_count(); ++k) result.push_back({id(), {k}});
    return result;
  }

 private:
  static constexpr double kLargest = 5e-3, kFurthest = 1e-3;  // [rad], [m]
  static constexpr double kLeastLoad = 1.0;                   // [Nm or N]
};

const RegisterEffect<StiffnessNonlinear> registered_stiffness_nonlinear;

}  // namespace
}  // namespace armtrue
