#include <nanobind/stl/map.h>
#include <nanobind/stl/string.h>

#include <nlohmann/json.hpp>

#include "fitter/effects/effect.h"
#include "fitter/python/arrays.h"
#include "fitter/python/parts.h"

namespace nb = nanobind;
using namespace nb::literals;
using nlohmann::json;

namespace armtrue {
namespace {

std::string effects_json() {
  static const std::map<JointRule, std::string> rules{{JointRule::kNone, "none"},
                                                      {JointRule::kEach, "each"},
                                                      {JointRule::kAll, "all"},
                                                      {JointRule::kPair, "pair"},
                                                      {JointRule::kFixed, "fixed"}};
  static const std::map<Role, std::string> roles{
      {Role::kPlacement, "placement"},     {Role::kGeometry, "geometry"},
      {Role::kPhysical, "physical"},       {Role::kTable, "table"},
      {Role::kMeasurement, "measurement"}, {Role::kCustom, "custom"}};
  static const std::map<DriveRule, std::string> drives{
      {DriveRule::kNone, "none"}, {DriveRule::kEach, "each"}, {DriveRule::kDriving, "driving"}};
  json catalogue = json::array();
  for (const Effect* effect : effect_catalogue()) {
    json options = json::object();
    for (const EffectOption& option : effect->options())
      options[option.name] = {{"type", option.type}, {"help", option.help}};
    catalogue.push_back({{"id", effect->id()},
                         {"summary", effect->summary()},
                         {"role", roles.at(effect->role())},
                         {"generic", effect->generic()},
                         {"joints", rules.at(effect->joint_rule())},
                         {"needs_drive", drives.at(effect->drive_rule())},
                         {"exported", effect->exported()},
                         {"bound", effect->bound_text()},
                         {"options", options}});
  }
  return catalogue.dump();
}

// Terms that depend on fitted springs or balancers are shown for one spring of 1 rad/Nm and a
// balancer of 1 mrad.
std::string effect_terms_json(const std::string& robot_json,
                              const std::map<std::string, Column>& arrays,
                              const std::string& request_json) {
  const Robot robot = Robot::from_json(json::parse(robot_json));
  const State state(robot, to_columns(arrays), Eigen::Vector3d::Zero());
  const json given = json::parse(request_json);
  EffectRequest request{given.at("effect").get<std::string>(),
                        given.value("joints", std::vector<int>{}),
                        given.value("options", json::object())};
  EffectContext context{state};
  context.springs = {{motor(2), "tau2", 1.0}};
  context.carried.emplace("tau2", Expression::parse("1e-3*sin(q2)"));
  const EffectTerms terms = build_effect(context, request);
  std::map<std::string, std::vector<double>> found;
  json nonlinear = json::array();
  for (const NonlinearParameter& p : terms.nonlinear) {
    found[p.name] = {p.value};
    nonlinear.push_back(
        {{"name", p.name}, {"unit", p.unit}, {"lower", p.lower}, {"upper", p.upper}});
  }
  json parameters = json::array();
  for (const Parameter& p : terms.parameters) {
    json parameter = to_json(p, 1);
    for (std::size_t t = 0; t < p.terms.size(); ++t) {
      parameter["terms"][t]["values"] = p.terms[t].basis.evaluate(
          state.rows(), [&](const std::string& name) -> const std::vector<double>& {
            const auto at = found.find(name);
            return at != found.end() ? at->second : state.column(name);
          });
    }
    parameters.push_back(std::move(parameter));
  }
  return json{{"parameters", parameters}, {"nonlinear", nonlinear}}.dump();
}

}  // namespace

void bind_catalogue(nb::module_& m) {
  m.def("effects", &effects_json,
        "The effect catalogue as JSON: id, summary, whether it fits any cause, joints rule, "
        "options, physical bound.");
  m.def(
      "effect_terms", &effect_terms_json, "robot"_a, "columns"_a, "request"_a,
      "The terms that an effect adds on an arm: parameters and nonlinear parameters as JSON, each "
      "term with its basis evaluated on every row. Request: {effect, joints, options}.");
}

}  // namespace armtrue
