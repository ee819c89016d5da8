#include "fitter/model/term.h"

#include <nlohmann/json.hpp>

namespace armtrue {

using nlohmann::json;

json to_json(const Term& term, int targets) {
  json value{{"coordinate", to_string(term.coordinate, targets)},
             {"expression", term.basis.to_string()},
             {"weight", term.weight},
             {"table", nullptr}};
  if (term.table) {
    json axes = json::array();
    for (const TableReference::Axis& axis : term.table->axes) {
      axes.push_back({{"variable", axis.variable}, {"nodes", axis.nodes}});
    }
    value["table"] = {{"id", term.table->id}, {"axes", axes}, {"index", term.table->index}};
  }
  return value;
}

Term term_from_json(const json& value, int joints, int targets) {
  Term term;
  term.coordinate = parse_coordinate(value.at("coordinate").get<std::string>(), joints, targets);
  term.basis = Expression::parse(value.at("expression").get<std::string>());
  term.weight = value.value("weight", 1.0);
  if (value.contains("table") && !value["table"].is_null()) {
    TableReference table;
    value["table"].at("id").get_to(table.id);
    for (const json& axis : value["table"].at("axes")) {
      table.axes.push_back(
          {axis.at("variable").get<std::string>(), axis.at("nodes").get<std::vector<double>>()});
    }
    table.index = value["table"].at("index").get<std::vector<int>>();
    term.table = table;
  }
  return term;
}

json to_json(const Parameter& p, int targets) {
  json terms = json::array();
  for (const Term& term : p.terms) terms.push_back(to_json(term, targets));
  return {{"name", p.name},   {"effect", p.effect},     {"joints", p.joints}, {"unit", p.unit},
          {"value", p.value}, {"exported", p.exported}, {"fixed", p.fixed},   {"bound", p.bound},
          {"sign", p.sign},   {"terms", terms}};
}

}  // namespace armtrue
