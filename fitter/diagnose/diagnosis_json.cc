#include <nlohmann/json.hpp>

#include "fitter/diagnose/diagnose.h"

namespace armtrue {

using nlohmann::json;

json parameters_json(const Candidate& candidate) {
  json parameters = json::array();
  for (std::size_t i = 0; i < candidate.parameters.size(); ++i) {
    parameters.push_back({{"name", candidate.parameters[i].name},
                          {"value", candidate.parameters[i].value},
                          {"sigma", candidate.sigma[i]},
                          {"unit", candidate.parameters[i].unit}});
  }
  return parameters;
}

json Diagnosis::to_json(const Fit& fit) const {
  static const char* const verdicts[] = {"nothing_missing", "missing_effect",
                                         "unexplained_structure"};
  const json document = fit.errors_document();
  json joints = json::array();
  for (const double sigma : noise.joint) joints.push_back(sigma * 1e6);
  const bool turns = orientation_sigma > 0.0;
  const json noise_json{{"reading_um", reading_sigma * 1e6},
                        {"orientation_urad", turns ? json(orientation_sigma * 1e6) : json(nullptr)},
                        {"joints_urad", joints},
                        {"pose_um", noise.pose ? json(*noise.pose * 1e6) : json(nullptr)}};
  json result{{"verdict", verdicts[static_cast<int>(verdict)]},
              {"probability_nothing", probability_nothing},
              {"error",
               {{"train", document["error"]["train"]},
                {"held_out", document["error"]["held_out"]},
                {"held_out_by", document["error"]["held_out_by"]}}},
              {"noise", noise_json},
              {"noise_floor_um", document["noise_floor"]["um"]},
              {"noise_floor_source", document["noise_floor"]["source"]},
              {"instrument_floor_um", nullptr},
              {"advice", advice},
              {"neighbour_ratio", neighbour_ratio}};
  if (fit.noise_floor().source == "targets") {
    // Distances between reflectors do not contain the arm's repeatability: no noise floor.
    result["instrument_floor_um"] = result["noise_floor_um"];
    result["noise_floor_um"] = nullptr;
    result["noise_floor_source"] = "none";
  }
  for (const char* part : {"cross_validation", "with_history"}) {
    if (document["error"].contains(part)) result["error"][part] = document["error"][part];
  }
  result["candidates"] = json::array();
  for (const Candidate& c : candidates) {
    result["candidates"].push_back({{"effect", c.request.effect},
                                    {"joints", c.request.joints},
                                    {"options", c.request.options},
                                    {"parameters", parameters_json(c)},
                                    {"recommend", c.recommend},
                                    {"explained", c.score.explained},
                                    {"log10_p", c.log10_p},
                                    {"delta_bic", c.delta_bic},
                                    {"degrees", c.score.degrees},
                                    {"separability", c.score.separability},
                                    {"probability", c.probability},
                                    {"held_out_mean_um_if_added", c.held_out_mean * 1e6},
                                    {"confounded_with", c.confounded_with},
                                    {"why", c.why}});
  }
  result["tables"] = armtrue::to_json(tables);
  result["untestable"] = armtrue::to_json(untestable);
  result["unexplained"] = json::array();
  for (const StructureFinding& f : unexplained()) {
    std::string variable;
    for (const std::string& v : f.variables) variable += (variable.empty() ? "" : "*") + v;
    result["unexplained"].push_back({{"variable", variable},
                                     {"variables", f.variables},
                                     {"joints", f.joints},
                                     {"coordinate", f.coordinate},
                                     {"log10_p", f.log10_p},
                                     {"explained", f.score.explained},
                                     {"shape", f.shape},
                                     {"curve", {{"x", f.x}, {"y", f.y}}}});
  }
  const bool unnamed = verdict == Verdict::kUnexplainedStructure && structure.empty();
  if (unnamed && gross) {
    const std::string variable = "q" + std::to_string(gross->joint);
    result["unexplained"].push_back({{"variable", variable},
                                     {"variables", {variable}},
                                     {"joints", {gross->joint}},
                                     {"log10_p", gross->log10_p},
                                     {"shape", gross_words(*gross)}});
  } else if (unnamed && !has_structure()) {
    for (const Candidate& c : candidates) {
      if (&c != left_out() && !(c.left_out && c.probability > kMoreLikelyThanNot)) continue;
      result["unexplained"].push_back(
          {{"variable", "none recorded"},
           {"variables", json::array()},
           {"joints", c.request.joints},
           {"log10_p", c.log10_p},
           {"shape", "like " + label(c.request) + ", which held-out poses do not confirm"}});
    }
  } else if (unnamed) {
    result["unexplained"].push_back(
        {{"variable", "none recorded"},
         {"variables", json::array()},
         {"joints", json::array()},
         {"log10_p", lack_of_fit.log10_p},
         {"shape", "more scatter than the " + lack_of_fit.against + " allow"}});
  }
  result["lack_of_fit"] = {{"testable", lack_of_fit.testable},
                           {"against", lack_of_fit.against},
                           {"log10_p", lack_of_fit.log10_p}};
  result["spectra"] = json::array();
  for (const JointSpectrum& s : spectra) {
    result["spectra"].push_back({{"joint", s.joint},
                                 {"resolution", s.resolution},
                                 {"cycles", s.cycles},
                                 {"explained", s.power},
                                 {"per", s.slides ? "m" : "turn"},
                                 {s.slides ? "amplitude_m" : "amplitude_rad", s.amplitude}});
  }
  return result;
}

}  // namespace armtrue
