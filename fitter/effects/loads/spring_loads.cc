#include "fitter/effects/loads/spring_loads.h"

#include <algorithm>
#include <cmath>

namespace armtrue {
namespace {

bool is_zero(const State& state, const Expression& basis) {
  const std::vector<double> values = state.values(basis);
  return std::none_of(values.begin(), values.end(), [](double v) { return std::abs(v) > 1e-9; });
}

}  // namespace

Parameter load_change(const EffectContext& context, const std::string& effect,
                      const std::string& suffix, const std::string& unit, double bound,
                      double usual, const std::function<std::string(const Variable&)>& change) {
  Parameter p;
  p.name = parameter_name(effect, {}, suffix);
  p.effect = effect;
  p.unit = unit;
  p.bound = bound;
  p.usual = usual;
  p.prior_sigma = usual;
  for (const Spring& spring : context.springs) {
    const auto load = parse_variable(spring.load, context.joint_count());
    const std::string text = load ? change(*load) : "";
    if (text.empty()) continue;
    const Expression basis =
        Expression::apply(Expression::Op::kMultiply, {spring.yields, Expression::parse(text)});
    if (!is_zero(context.state, basis))
      p.terms.push_back({spring.coordinate, basis, spring.compliance, std::nullopt});
  }
  return p;
}

std::vector<std::string> LoadEffect::missing(const EffectContext& context,
                                             const std::vector<int>&) const {
  if (!context.state.computes_torque()) return {"mass and com of robot.yaml's links"};
  if (context.springs.empty()) return {"a spring in the model, such as joint_compliance"};
  return {};
}

}  // namespace armtrue
