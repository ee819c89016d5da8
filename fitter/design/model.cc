#include "fitter/design/model.h"

#include <algorithm>
#include <numbers>
#include <optional>

namespace armtrue {

using nlohmann::json;

namespace {

// Only keeps the number within an int. Whether the arm has the joint is checked when the terms of
// the effect are built.
constexpr int kMostJoints = 1000;

EffectRequest request_from_json(const json& entry) {
  EffectRequest request;
  if (entry.is_string()) {
    entry.get_to(request.effect);
    return request;
  }
  entry.at("effect").get_to(request.effect);
  for (const auto& [key, value] : entry.items()) {
    if (key == "effect") continue;
    if (key == "joints") {
      if (!value.is_array() && !value.is_null())
        throw ModelError("effect " + request.effect + ": found joints " + value.dump() +
                         ", expected a list");
      for (const json& joint : value)
        request.joints.push_back(joint_number(joint, kMostJoints, "effect " + request.effect));
    } else {
      request.options[key] = value;
    }
  }
  return request;
}

// d(basis)/d(load) if the basis is a power of one load, or a load times its magnitude: the forms of
// the catalogue's springs. nullopt for any other basis.
std::optional<Expression> slope_of(const Expression& basis) {
  using Op = Expression::Op;
  const auto is = [](const Expression& e, Op op) { return e.op() == op; };
  if (is(basis, Op::kVariable)) return Expression::number(1.0);
  const std::vector<Expression>& parts = basis.arguments();
  if (is(basis, Op::kPower) && is(parts[0], Op::kVariable) && parts[1].is_constant()) {
    const double power = parts[1].value();
    return Expression::apply(
        Op::kMultiply,
        {Expression::number(power),
         Expression::apply(Op::kPower, {parts[0], Expression::number(power - 1.0)})});
  }
  if (is(basis, Op::kMultiply) && is(parts[0], Op::kVariable) && is(parts[1], Op::kAbs))
    return Expression::apply(Op::kMultiply, {Expression::number(2.0), parts[1]});
  return std::nullopt;
}

}  // namespace

ModelSpecification ModelSpecification::from_json(const json& content) {
  ModelSpecification specification;
  for (const json& entry : content.at("effects"))
    specification.effects.push_back(request_from_json(entry));
  if (content.contains("priors") && !content["priors"].is_null()) {
    const json& priors = content["priors"];
    specification.priors.angle = priors.value("angle_deg", 0.3) * std::numbers::pi / 180.0;
    specification.priors.length = priors.value("length_mm", 2.0) * 1e-3;
  }
  if (content.contains("parameters") && !content["parameters"].is_null()) {
    for (const auto& [name, value] : content["parameters"].items()) {
      ParameterOverride o;
      o.fixed = value.contains("fixed");
      o.value = o.fixed ? value["fixed"].get<double>() : value.value("prior", 0.0);
      o.sigma = value.value("sigma", 0.0);
      specification.overrides[name] = o;
    }
  }
  return specification;
}

json ModelSpecification::to_json() const {
  json content{{"effects", json::array()}};
  for (const EffectRequest& request : effects) {
    json entry = request.options.is_object() ? request.options : json::object();
    entry["effect"] = request.effect;
    if (!request.joints.empty()) entry["joints"] = request.joints;
    content["effects"].push_back(entry);
  }
  content["priors"] = {{"angle_deg", priors.angle * 180.0 / std::numbers::pi},
                       {"length_mm", priors.length * 1e3}};
  for (const auto& [name, o] : overrides) {
    content["parameters"][name] =
        o.fixed ? json{{"fixed", o.value}} : json{{"prior", o.value}, {"sigma", o.sigma}};
  }
  return content;
}

ModelSpecification ModelSpecification::without(
    const std::function<bool(const EffectRequest&)>& unwanted) const {
  ModelSpecification rest = *this;
  std::erase_if(rest.effects, unwanted);
  for (const EffectRequest& e : effects) {
    if (!unwanted(e)) continue;
    std::erase_if(rest.overrides,
                  [&](const auto& entry) { return entry.first.starts_with(e.effect + "."); });
  }
  return rest;
}

bool ModelSpecification::contains(const std::string& effect) const {
  return std::any_of(effects.begin(), effects.end(),
                     [&](const EffectRequest& r) { return r.effect == effect; });
}

int Model::index(const std::string& name) const {
  for (std::size_t i = 0; i < parameters.size(); ++i) {
    if (parameters[i].name == name) return static_cast<int>(i);
  }
  return -1;
}

std::vector<Spring> springs_of(const Model& model, int joints) {
  std::vector<Spring> springs;
  for (const Parameter& p : model.parameters) {
    for (const Term& term : p.terms) {
      const std::set<std::string> read = term.basis.variables();
      if (read.size() != 1 || p.value == 0.0) continue;
      const auto load = parse_variable(*read.begin(), joints);
      if (!load) continue;
      const bool is_load = load->kind == VariableKind::kTorque ||
                           load->kind == VariableKind::kMoment ||
                           load->kind == VariableKind::kBaseMoment;
      if (!is_load) continue;
      if (auto yields = slope_of(term.basis))
        springs.push_back({term.coordinate, load->name, p.value * term.weight, std::move(*yields)});
    }
  }
  return springs;
}

std::map<std::string, Expression> carried_of(const Model& model) {
  std::map<std::string, double> found;
  for (const NonlinearParameter& p : model.nonlinear) found[p.name] = p.value;
  std::map<std::string, std::string> sums;
  for (const Parameter& p : model.parameters) {
    const auto load = find_effect(p.effect).carries();
    if (!load || p.value == 0.0) continue;
    std::string& sum = sums[load->torque];
    sum += (sum.empty() ? "(" : " + (") + Expression::number(p.value).to_string() + ")*(" +
           p.terms.front().basis.substitute(found).to_string() + ")";
  }
  std::map<std::string, Expression> result;
  for (const auto& [load, sum] : sums) result.emplace(load, Expression::parse(sum));
  return result;
}

namespace {

bool reads_any(const Parameter& parameter, const std::function<bool(const std::string&)>& wanted) {
  return std::ranges::any_of(parameter.terms, [&](const Term& term) {
    return std::ranges::any_of(term.basis.variables(), wanted);
  });
}

}  // namespace

std::set<std::string> effects_hiding_loads(const Model& model) {
  std::set<std::string> hiding;
  for (const Parameter& carrier : model.parameters) {
    if (!find_effect(carrier.effect).carries()) continue;
    const Term& carried = carrier.terms.front();
    const std::set<std::string> read = carried.basis.variables();
    for (const Parameter& p : model.parameters) {
      const Effect& effect = find_effect(p.effect);
      if (effect.carries() || effect.role() == Role::kPlacement || effect.role() == Role::kGeometry)
        continue;
      const bool hides = std::ranges::any_of(p.terms, [&](const Term& term) {
        return term.coordinate == carried.coordinate &&
               std::ranges::includes(read, term.basis.variables());
      });
      if (hides) hiding.insert(p.effect);
    }
  }
  return hiding;
}

bool is_foreseeable(const Parameter& parameter, int joints) {
  return !reads_any(parameter, [&](const std::string& name) {
    const auto variable = parse_variable(name, joints);
    return variable && variable->kind == VariableKind::kWarmth;
  });
}

bool reads_point(const Parameter& parameter) {
  return reads_any(
      parameter, [](const std::string& name) { return name == "x" || name == "y" || name == "z"; });
}

std::map<std::string, std::string> columns_needed(const Model& model, const State& state) {
  std::map<std::string, std::string> columns;
  std::set<std::string> found;  // nonlinear parameters, which stand in expressions too
  for (const NonlinearParameter& p : model.nonlinear) found.insert(p.name);
  for (const Parameter& p : model.parameters) {
    if (!is_foreseeable(p, state.robot().joint_count()) || reads_point(p)) continue;
    for (const Term& term : p.terms) {
      for (const std::string& name : term.basis.variables()) {
        const auto variable = parse_variable(name, state.robot().joint_count());
        if (!variable || found.contains(name)) continue;
        // If the set-up of a row is not recorded, its prediction is in the first set-up's frame.
        if (!p.exported && variable->kind == VariableKind::kColumn) continue;
        const bool is_read_back = variable->kind == VariableKind::kReadBack;
        for (const std::string& column :
             columns_of(*variable, state.robot(), state.recorded("payload"))) {
          // At rest, a joint reads back its command.
          columns[column] = is_read_back ? "q" + std::to_string(variable->joint) : "";
        }
      }
    }
  }
  return columns;
}

Model build_model(const ModelSpecification& specification, const EffectContext& given) {
  EffectContext context = given;
  context.priors = specification.priors;
  Model model;
  std::set<std::string> names;
  for (const EffectRequest& request : specification.effects) {
    EffectTerms terms = build_effect(context, request);
    for (Parameter& p : terms.parameters) {
      if (!names.insert(p.name).second) {
        throw ModelError("model: found parameter " + p.name + " of effect " + p.effect +
                         " twice, expected each effect once on a joint");
      }
      model.parameters.push_back(std::move(p));
    }
    for (NonlinearParameter& p : terms.nonlinear) {
      if (!names.insert(p.name).second)
        throw ModelError("model: found parameter " + p.name + " twice, expected it once");
      model.nonlinear.push_back(std::move(p));
    }
    std::move(terms.penalties.begin(), terms.penalties.end(), std::back_inserter(model.penalties));
  }
  std::erase_if(model.penalties, [&](const Penalty& p) {
    return !p.only_with.empty() && !names.contains(p.only_with);
  });
  for (const auto& [name, o] : specification.overrides) {
    const int index = model.index(name);
    if (index < 0)
      throw ModelError("model: parameters names '" + name + "', which no effect of the model has");
    Parameter& p = model.parameters[static_cast<std::size_t>(index)];
    p.fixed = o.fixed;
    // place_as_stated moves base and tool to their stated poses, so that the mean is 0.
    const bool is_placement = find_effect(p.effect).role() == Role::kPlacement;
    p.prior_mean = is_placement ? 0.0 : o.value;
    p.value = p.prior_mean;
    if (!o.fixed) p.prior_sigma = o.sigma;
  }
  return model;
}

}  // namespace armtrue
