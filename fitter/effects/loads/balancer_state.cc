#include "fitter/effects/effect.h"

namespace armtrue {
namespace {

class BalancerState final : public Effect {
 public:
  std::string id() const override { return "balancer_state"; }
  std::string summary() const override {
    return "the balancer's gas pressure follows its temperature, and its seals rub";
  }
  JointRule joint_rule() const override { return JointRule::kFixed; }
  std::string bound_text() const override {
    return "0 to 7e-3 of its torque a kelvin, twice a gas's 1/293; friction up to 0.2 of it, "
           "against the motion: ours";
  }

  bool reads_springs() const override { return true; }
  bool reads_carried() const override { return true; }

  std::vector<EffectOption> options() const override {
    return {{"sensor", "string", "temperature sensor, default the first"}};
  }

  std::vector<int> default_joints(const EffectContext&) const override { return {kAxis}; }

  std::vector<std::string> missing(const EffectContext& context,
                                   const std::vector<int>&) const override {
    if (!context.carried.contains(kLoad)) return {"a gravity_balancer in the model"};
    std::vector<std::string> lacking;
    if (context.state.sensors().empty()) lacking.emplace_back("temp_NAME");
    if (!context.state.has("dir" + std::to_string(kAxis)))
      lacking.push_back("dir" + std::to_string(kAxis));
    return lacking;
  }

  EffectTerms build(const EffectContext& context, const EffectRequest& request) const override {
    const std::string gives = "(" + context.carried.at(kLoad).to_string() + ")";
    EffectTerms terms;
    Parameter pressure = single_term(id(), {kAxis}, "pressure", "1/K", kMostPressure, motor(kAxis),
                                     gives + "*" + temperature_variable(request));
    pressure.sign = 1;
    Parameter friction = single_term(id(), {kAxis}, "friction", "1", kMostFriction, motor(kAxis),
                                     "abs" + gives + "*dir" + std::to_string(kAxis));
    friction.sign = -1;
    friction.sign_doubt = kCountedOtherwise;
    pressure.terms.front().follows = {kLoad, Expression::parse(temperature_variable(request))};
    friction.terms.front().follows = {
        kLoad, Expression::parse("sign" + gives + "*dir" + std::to_string(kAxis))};
    terms.parameters = {pressure, friction};
    return terms;
  }

  std::vector<EffectRequest> candidates(const EffectContext& context) const override {
    std::vector<EffectRequest> result;
    for (const std::string& sensor : context.state.sensors())
      result.push_back({id(), {kAxis}, {{"sensor", sensor}}});
    return result;
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
