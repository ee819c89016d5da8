#include <algorithm>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "fitter/refine/refine.h"

namespace armtrue {
namespace {

using nlohmann::json;

// Why an improbable effect stays in the model.
const char* const kWhyKept =
    "kept: without it unseen poses are predicted worse, or the search asks for it again";

// The effects of a step's model. Those that the refinement added have their probability: of several
// joints, that of the least probable one. Joints that probably lack the effect have an entry of
// their own.
json effects_of(const RefineStep& step) {
  json result = json::array();
  const std::vector<EffectRequest>& effects = step.fit->specification().effects;
  const json entries = step.fit->specification().to_json()["effects"];
  for (std::size_t e = 0; e < effects.size(); ++e) {
    std::map<bool, std::pair<std::vector<int>, std::optional<double>>> groups;  // by "is doubtful"
    for (const EffectRequest& part : parts_of(step.fit->context(), effects[e])) {
      const auto found = step.diagnosis.probability_present.find(label(part));
      const bool known = found != step.diagnosis.probability_present.end();
      auto& [joints, least] = groups[known && found->second <= kMoreLikelyThanNot];
      joints.insert(joints.end(), part.joints.begin(), part.joints.end());
      if (known) least = std::min(least.value_or(1.0), found->second);
    }
    for (const auto& [is_doubtful, group] : groups) {
      json entry = entries[e];
      if (groups.size() > 1) entry["joints"] = group.first;
      if (group.second) entry["probability"] = *group.second;
      result.push_back(std::move(entry));
    }
  }
  return result;
}

}  // namespace

json RefineStep::document() const {
  json result = diagnosis.to_json(*fit);
  result.erase("spectra");
  auto& candidates = result["candidates"].get_ref<json::array_t&>();
  candidates.resize(std::min(candidates.size(), DiagnoseOptions().listed));  // as `diagnose` does
  result["added"] = nullptr;
  if (added) {
    std::vector<std::string> stand_ins = added->confounded_with;
    std::erase_if(stand_ins, [&](const std::string& name) {
      return diagnosis.probability_present.contains(name);  // both are in the model
    });
    result["added"] = {{"effect", added->request.effect},
                       {"joints", added->request.joints},
                       {"options", added->request.options},
                       {"parameters", parameters_json(*added)},
                       {"confounded_with", stand_ins}};
  }
  result["removed"] = json::array();
  for (const EffectRequest& r : removed) {
    result["removed"].push_back({{"effect", r.effect},
                                 {"joints", r.joints},
                                 {"options", r.options},
                                 {"parameters", json::array()}});
  }
  result["effects"] = effects_of(*this);
  return result;
}

}  // namespace armtrue
