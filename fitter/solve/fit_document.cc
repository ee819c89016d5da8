// The part of fit.json that the library writes (docs/model.md).
#include <algorithm>
#include <cmath>
#include <map>
#include <nlohmann/json.hpp>
#include <utility>

#include "fitter/design/effect_sizes.h"
#include "fitter/solve/fit.h"

namespace armtrue {
namespace {

using nlohmann::json;

json to_json(const ErrorSummary& s) {
  return {{"mean_um", s.mean * 1e6},
          {"rms_um", s.rms * 1e6},
          {"p95_um", s.p95 * 1e6},
          {"max_um", s.max * 1e6},
          {"n", s.count}};
}

json to_json(const Pose& pose) {
  const Eigen::Vector3d p = pose.translation();
  const Eigen::Vector3d a = rpy_from_rotation(pose.linear());
  return {{"xyz", {p.x(), p.y(), p.z()}}, {"rpy", {a.x(), a.y(), a.z()}}};
}

// The three parameters that correlate most with an unknown.
json correlations_json(const Fit& fit, const Eigen::MatrixXd& covariance, int unknown) {
  std::vector<std::pair<double, int>> partners;
  for (int u = 0; u < static_cast<int>(fit.design().free_parameters().size()); ++u) {
    if (u == unknown) continue;
    const double r =
        covariance(unknown, u) / std::sqrt(covariance(unknown, unknown) * covariance(u, u));
    partners.emplace_back(r, u);
  }
  const std::size_t count = std::min<std::size_t>(3, partners.size());
  std::partial_sort(
      partners.begin(), partners.begin() + static_cast<std::ptrdiff_t>(count), partners.end(),
      [](const auto& a, const auto& b) { return std::abs(a.first) > std::abs(b.first); });
  json correlations = json::array();
  for (std::size_t k = 0; k < count; ++k) {
    const int other = fit.design().free_parameters()[static_cast<std::size_t>(partners[k].second)];
    correlations.push_back({{"with", fit.model().parameters[static_cast<std::size_t>(other)].name},
                            {"r", partners[k].first}});
  }
  return correlations;
}

json parameters_json(const Fit& fit, const Eigen::MatrixXd& covariance) {
  const int targets = fit.measurements().targets;
  std::map<std::string, double> nonlinear;
  for (const NonlinearParameter& p : fit.model().nonlinear) nonlinear[p.name] = p.value;
  json parameters = json::array();
  for (std::size_t i = 0; i < fit.model().parameters.size(); ++i) {
    Parameter p = fit.model().parameters[i];
    for (Term& term : p.terms) term.basis = term.basis.substitute(nonlinear);
    json entry = to_json(p, targets);
    const int unknown = fit.design().unknown_of(static_cast<int>(i));
    entry["fixed"] = p.fixed;
    entry["held"] = unknown < 0 && !p.fixed;
    entry["sigma"] =
        unknown >= 0 ? json(std::sqrt(std::max(0.0, covariance(unknown, unknown)))) : json(nullptr);
    if (unknown >= 0 && !fit.design().is_table_unknown(unknown)) {
      entry["correlations"] = correlations_json(fit, covariance, unknown);
    }
    parameters.push_back(entry);
  }
  return parameters;
}

json nonlinear_json(const Fit& fit, const Eigen::MatrixXd& covariance) {
  json nonlinear = json::array();
  for (std::size_t j = 0; j < fit.model().nonlinear.size(); ++j) {
    const NonlinearParameter& p = fit.model().nonlinear[j];
    const auto u = static_cast<Eigen::Index>(fit.design().free_parameters().size() + j);
    nonlinear.push_back({{"name", p.name},
                         {"effect", p.effect},
                         {"joints", p.joints},
                         {"unit", p.unit},
                         {"value", p.value},
                         {"sigma", std::sqrt(std::max(0.0, covariance(u, u)))}});
  }
  return nonlinear;
}

json error_json(const Fit& fit) {
  json error{{"nominal", to_json(fit.nominal_error())},
             {"train", to_json(fit.train_error())},
             {"held_out", to_json(fit.held_out_errors()[0])}};
  error["held_out_by"] =
      error["cross_validation"] = {{"random", to_json(fit.held_out_errors()[0])},
                                   {"time", to_json(fit.held_out_errors()[1])},
                                   {"region", to_json(fit.held_out_errors()[2])}};
  if (fit.knows_history()) {
    error["with_history"] = {{"train", to_json(fit.train_error_with_history())},
                             {"held_out", to_json(fit.held_out_with_history().errors[0])}};
  }
  error["folds"] = fit.options().folds;
  error["seed"] = fit.options().seed;
  return error;
}

json noise_floor_json(const NoiseFloor& floor) {
  return {{"um", std::isfinite(floor.mean) ? json(floor.mean * 1e6) : json(nullptr)},
          {"source", floor.source}};
}

json noise_json(const Fit& fit) {
  return {
      {"sigma_um", fit.measurements().typical_sigma * 1e6},
      {"stated_sigma_um", fit.measurements().sigma_source == SigmaSource::kAssumed
                              ? json(nullptr)
                              : json(fit.measurements().typical_sigma / fit.noise_scale() * 1e6)},
      {"sigma_rotation_rad", fit.measurements().has_rotation()
                                 ? json(fit.measurements().sigma_rotation)
                                 : json(nullptr)}};
}

}  // namespace

json Fit::errors_document() const {
  return {{"error", error_json(*this)}, {"noise_floor", noise_floor_json(noise_floor_)}};
}

json Fit::document() const {
  const int targets = measurements_.targets;
  const Eigen::MatrixXd covariance = this->covariance();
  json document = errors_document();
  for (const auto& [number, pose] : prepared_->alignment.first_from_set_up)
    document["first_from_set_up"][std::to_string(number)] = to_json(pose);
  document["measuring_from_base"] = to_json(kinematics_->base());
  json tools = json::object();
  for (int t = 0; t < targets; ++t)
    tools[targets > 1 ? std::to_string(t) : ""] = to_json(kinematics_->tool(t));
  document["flange_from_tool"] = tools;

  document["parameters"] = parameters_json(*this, covariance);
  document["nonlinear"] = nonlinear_json(*this, covariance);
  document["noise"] = noise_json(*this);
  document["smoothness_sigma"] = smoothness_.sigma;
  document["rejected"] = json::array();
  for (const RejectedRow& r : rejected_) {
    document["rejected"].push_back({{"index", r.row}, {"residual_um", r.residual * 1e6}});
  }
  document["unobservable"] = json::array();
  for (const Unidentifiable& held : identifiability_.held)
    document["unobservable"].push_back(held.sentence);
  document["warnings"] = warnings_;
  document["solver"] = {{"iterations", summary_.iterations},
                        {"converged", summary_.converged},
                        {"message", summary_.message}};
  document["columns"] = columns_needed(model_, state());
  document["effects_move_um"] = json::object();
  for (const auto& [effect, metres] : effect_sizes(*design_))
    document["effects_move_um"][effect] = metres * 1e6;
  if (state().recorded("time")) document["time_origin_s"] = state().time_origin();
  document["statics"] = state().loads_follow() ? "deflected" : "nominal";
  document["payload_point"] = {state().payload_point().x(), state().payload_point().y(),
                               state().payload_point().z()};
  return document;
}

}  // namespace armtrue
