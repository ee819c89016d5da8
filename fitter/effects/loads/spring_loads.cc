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

LoadEffect::LoadEffect(EffectTraits traits)
    : Effect([&] {
        traits.joints = JointRule::kNone;
        traits.reads_springs = true;
        return std::move(traits);
      }()) {}

void LoadEffect::add_change(const EffectContext& context, const std::string& suffix,
                            const std::string& unit, double bound, double usual,
                            const std::function<std::string(const Variable&)>& change,
                            EffectTerms& terms) const {
  Parameter& p = add(terms, {}, suffix, unit, bound, {}, "0");
  p.usual = p.prior_sigma = usual;
  p.terms.clear();
  for (const Spring& spring : context.springs) {
    const auto load = parse_variable(spring.load, context.joint_count());
    const std::string text = load ? change(*load) : "";
    if (text.empty()) continue;
    const Expression basis = spring.yields * Expression::parse(text);
    if (!is_zero(context.state, basis))
      p.terms.push_back({spring.coordinate, basis, spring.compliance});
  }
  if (p.terms.empty()) terms.parameters.pop_back();
}

std::vector<std::string> LoadEffect::missing(const EffectContext& context,
                                             const std::vector<int>&) const {
  if (!context.state.computes_torque()) return {"mass and com of robot.yaml's links"};
  if (context.springs.empty()) return {"a spring in the model, such as joint_compliance"};
  return {};
}

}  // namespace armtrue
