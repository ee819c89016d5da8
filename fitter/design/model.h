// A model: effects, and the parameters and terms they give on one arm with one set of recorded
// columns.
#pragma once

#include <functional>
#include <map>
#include <nlohmann/json_fwd.hpp>
#include <set>
#include <string>
#include <vector>

#include "fitter/effects/effect.h"

namespace armtrue {

/// What model.yaml states for a single parameter.
struct ParameterOverride {
  bool fixed = false;
  double value = 0.0;  ///< value where fixed, prior mean otherwise
  double sigma = 0.0;  ///< prior standard deviation
};

/// The content of model.yaml.
struct ModelSpecification {
  std::vector<EffectRequest> effects;
  std::map<std::string, ParameterOverride> overrides;
  GeometryPriors priors{};

  static ModelSpecification from_json(const nlohmann::json& content);
  nlohmann::json to_json() const;
  bool contains(const std::string& effect) const;
  /// Without these effects and what is stated of their parameters.
  ModelSpecification without(const std::function<bool(const EffectRequest&)>& unwanted) const;
};

/// Parameters of a specification, in order, without repetition.
struct Model {
  std::vector<Parameter> parameters;
  std::vector<NonlinearParameter> nonlinear;
  std::vector<Penalty> penalties;

  int index(const std::string& name) const;  ///< −1 where there is none
};

/// Springs of a fitted model: coefficients whose basis reads one gravity load and nothing else.
std::vector<Spring> springs_of(const Model& model, int joints);

/// The fitted terms of effects that carry a load (Effect::carries), summed by load.
std::map<std::string, Expression> carried_of(const Model& model);

/// Physical effects and tables that act where a carried load acts and depend on nothing else than
/// it does. Beside one of these, a fit can give the load any size.
std::set<std::string> effects_hiding_loads(const Model& model);

/// False if the parameter depends on the history before a pose, which no prediction has.
bool is_foreseeable(const Parameter& parameter, int joints);
/// Whether the parameter depends on the measured point, as the instrument's own errors do.
bool reads_point(const Parameter& parameter);

/// Columns that a file must hold for the model's predictions, each with the column that replaces it
/// for poses that have not been driven to yet; empty: none does.
std::map<std::string, std::string> columns_needed(const Model& model, const State& state);

/// Throws ModelError if an effect is unknown, lacks columns, or appears twice on one joint.
Model build_model(const ModelSpecification& specification, const EffectContext& context);

}  // namespace armtrue
