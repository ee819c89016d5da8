#include <nanobind/stl/function.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/string.h>

#include <nlohmann/json.hpp>

#include "fitter/plan/plan.h"
#include "fitter/python/parts.h"
#include "fitter/python/watched.h"

namespace nb = nanobind;
using namespace nb::literals;
using nlohmann::json;

namespace armtrue {
namespace {

PlanOptions plan_options(const std::string& options_json) {
  return PlanOptions::from_json(json::parse(options_json));
}

std::string campaign(const std::string& robot_json, const std::string& model_json,
                     const std::string& options_json, std::optional<Progress> progress) {
  return watched(std::move(progress), [&](WatchedCall& call) {
    return plan_campaign(Robot::from_json(json::parse(robot_json)),
                         ModelSpecification::from_json(json::parse(model_json)),
                         plan_options(options_json), call)
        .to_json()
        .dump();
  });
}

std::string sharpening(Fit& fit, const std::string& options_json,
                       std::optional<Progress> progress) {
  return watched(std::move(progress), [&](WatchedCall& call) {
    return plan_sharpening(fit, plan_options(options_json), call).to_json().dump();
  });
}

std::string evidence(Fit& fit, const std::string& effects_json) {
  const ModelSpecification asked =
      ModelSpecification::from_json({{"effects", json::parse(effects_json)}});
  const std::vector<std::optional<Evidence>> found =
      watched({}, [&](WatchedCall&) { return evidence_of(fit, asked.effects); });
  json result = json::array();
  for (const std::optional<Evidence>& e : found) {
    result.push_back(e ? json{{"delta_bic", e->delta_bic}, {"misfit", e->misfit}} : json(nullptr));
  }
  return result.dump();
}

std::string separation(Fit& fit, const std::string& candidates_json,
                       const std::string& options_json, std::optional<Progress> progress) {
  const ModelSpecification asked =
      ModelSpecification::from_json({{"effects", json::parse(candidates_json)}});
  return watched(std::move(progress), [&](WatchedCall& call) {
    return plan_separation(fit, asked.effects, plan_options(options_json), call).to_json().dump();
  });
}

}  // namespace

void bind_plan(nb::module_& module) {
  module.def("plan_campaign", &campaign, "robot"_a, "model"_a, "options"_a,
             "progress"_a = nb::none(),
             "Poses for a first campaign, D-optimal for the model's parameters: JSON.");
  module.def("plan_sharpening", &sharpening, "fit"_a, "options"_a, "progress"_a = nb::none(),
             "Further poses for a fit's own parameters: JSON.");
  module.def(
      "plan_evidence", &evidence, "fit"_a, "effects"_a,
      "What each effect (entries of model.yaml as JSON) brings: JSON of delta_bic and misfit, "
      "null where it cannot be fitted.");
  module.def("plan_separation", &separation, "fit"_a, "candidates"_a, "options"_a,
             "progress"_a = nb::none(),
             "Poses that tell candidate effects (entries of model.yaml as JSON) apart: JSON.");
}

}  // namespace armtrue
