#include "fitter/effects/effect.h"

namespace armtrue {
namespace {

class BalancerState final : public Effect {
 public:
  BalancerState()
      : Effect({.id = "balancer_state",
                .summary = "the balancer's gas pressure follows its temperature, and its seals rub",
                .bound = "0 to 7e-3 of its torque a kelvin, twice a gas's 1/293; friction up to "
                         "0.2 of it, against the motion: ours",
                .joints = JointRule::kFixed,
                .joint_columns = {"dir"},
                .by_sensor = true,
                .reads_springs = true,
                .reads_carried = true}) {}

  std::vector<int> default_joints(const EffectContext&) const override { return {kAxis}; }

  std::vector<std::string> missing(const EffectContext& context,
                                   const std::vector<int>&) const override {
    if (!context.carried.contains(kLoad)) return {"a gravity_balancer in the model"};
    return Effect::missing(context, {kAxis});
  }

  EffectTerms build(const EffectContext& context, const EffectRequest& request) const override {
    const std::string gives = "(" + context.carried.at(kLoad).to_string() + ")";
    EffectTerms terms;
    const std::string dT = temperature_variable(request), dir = "*dir" + std::to_string(kAxis);
    Parameter& pressure =
        add(terms, {kAxis}, "pressure", "1/K", kMostPressure, motor(kAxis), gives + "*" + dT);
    pressure.sign = 1;
    pressure.terms.front().follows = {kLoad, Expression::parse(dT)};
    Parameter& friction =
        add(terms, {kAxis}, "friction", "1", kMostFriction, motor(kAxis), "abs" + gives + dir);
    friction.sign = -1;
    friction.sign_doubt = kCountedOtherwise;
    friction.terms.front().follows = {kLoad, Expression::parse("sign" + gives + dir)};
    return terms;
  }

 private:
  static constexpr int kAxis = 2;
  static constexpr const char* kLoad = "tau2";
  static constexpr double kMostPressure = 7e-3;  // [1/K]
  static constexpr double kMostFriction = 0.2;
};

const RegisterEffect<BalancerState> registered_balancer_state;

}  // namespace
}  // namespace armtrue
