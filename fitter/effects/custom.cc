#include <cmath>
#include <map>

#include "fitter/effects/effect.h"

namespace armtrue {
namespace {

class Custom final : public Effect {
 public:
  Custom()
      : Effect(
            {.id = "custom",
             .summary = "a user's own term: a name, a coordinate, an expression of the state",
             .bound = "the user's: key bound, none by default",
             .role = Role::kCustom,
             .options = {
                 {"name", "string", "what to call it"},
                 {"coordinate", "string", "where it acts: motorK, base.C, linkK.C, tool.C"},
                 {"expression", "string", "basis function of the state (docs/model.md)"},
                 {"parameters", "{name: value}",
                  "numbers in the expression to be found from the data, with their initial values"},
                 {"unit", "string", "unit of the coefficient"},
                 {"bound", "number", "largest physical magnitude of the coefficient"},
                 {"measurement", "bool",
                  "true where it belongs to the measurement and is not exported"}}}) {}

  std::vector<int> default_joints(const EffectContext&) const override { return {}; }

  EffectTerms build(const EffectContext& context, const EffectRequest& request) const override {
    for (const char* key : {"name", "coordinate", "expression"}) {
      if (!request.options.contains(key) || !request.options[key].is_string()) {
        throw ModelError(std::string("effect custom: key ") + key +
                         " is missing, expected name, coordinate and expression");
      }
    }
    const auto name = request.options["name"].get<std::string>();
    const auto text = request.options["expression"].get<std::string>();
    EffectTerms terms;
    Parameter p;
    p.name = "custom." + name;
    p.effect = id();
    p.joints = request.joints;
    p.unit = request.options.value("unit", std::string("1"));
    p.bound = request.options.value("bound", 0.0);
    p.prior_sigma = 3.0 * p.bound;
    p.exported = !request.options.value("measurement", false);
    Term term;
    const auto coordinate = request.options["coordinate"].get<std::string>();
    term.coordinate = parse_coordinate(coordinate, context.joint_count(), context.targets);
    try {
      term.basis = Expression::parse(text);
    } catch (const ExpressionError& error) {
      throw ModelError("effect custom '" + name + "': expression '" + text + "' does not parse " +
                       error.what());
    }
    std::map<std::string, double> known;
    if (request.options.contains("parameters"))
      known = request.options["parameters"].get<std::map<std::string, double>>();
    std::map<std::string, std::string> unique;
    for (const std::string& variable : term.basis.variables()) {
      if (const auto found = known.find(variable); found != known.end()) {
        const double start = found->second, span = 10.0 * std::max(std::abs(start), 1e-6);
        terms.nonlinear.push_back({variable, id(), {}, "1", start, start - span, start + span, {}});
      } else if (!context.state.has(variable)) {
        throw ModelError(
            "effect custom '" + name + "': '" + variable +
            "' in the expression is neither a recorded state variable nor one of its parameters");
      }
    }
    p.terms.push_back(term);
    // A term on the tool acts on every reflector.
    if (term.coordinate.place == Place::kTool && coordinate.find('[') == std::string::npos) {
      for (term.coordinate.index = 1; term.coordinate.index < context.targets;
           ++term.coordinate.index) {
        p.terms.push_back(term);
      }
    }
    terms.parameters.push_back(p);
    return terms;
  }

  std::vector<EffectRequest> candidates(const EffectContext&) const override { return {}; }
};

const RegisterEffect<Custom> registered_custom;

}  // namespace
}  // namespace armtrue
