// A model: effects, and the parameters and terms they give on one arm with one set of recorded
// columns.
#pragma once

#include <map>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "fitter/effects/effect.h"

namespace armtrue {

/// What a user says of single parameters in model.yaml.
struct ParameterOverride {
  bool fixed = false;
  double value = 0.0;  ///< value where fixed, prior mean otherwise
  double sigma = 0.0;  ///< prior standard deviation
};

/// model.yaml in the form that computations want.
struct ModelSpecification {
  std::vector<EffectRequest> effects;
  std::map<std::string, ParameterOverride> overrides;
  GeometryPriors priors{};

  static ModelSpecification from_json(const nlohmann::json& content);
  nlohmann::json to_json() const;
  bool contains(const std::string& effect) const;
};

/// Parameters of a specification, in order, without repetition.
struct Model {
  std::vector<Parameter> parameters;
  std::vector<NonlinearParameter> nonlinear;
  std::vector<Penalty> penalties;

  int index(const std::string& name) const;  ///< −1 where there is none
};

/// Springs of a fitted model: coefficients whose basis is one load of gravity, and no more.
std::vector<Spring> springs_of(const Model& model, int joints);

/// What a fitted model has of effects that carry a load (Effect::carries), by that load.
std::map<std::string, Expression> carried_of(const Model& model);

/// False where it takes the way to a pose: no prediction has that.
bool is_foreseeable(const Parameter& parameter, int joints);
/// Whether it depends on where the instrument saw the point, as its own errors do.
bool reads_point(const Parameter& parameter);

/// Columns that a file must hold for the model's predictions, and for each what stands in for it
/// where poses have not been driven to yet; empty: nothing does.
std::map<std::string, std::string> columns_needed(const Model& model, const State& state);

/// Throws ModelError where an effect is unknown, lacks columns, or stands twice on the same joint.
Model build_model(const ModelSpecification& specification, const EffectContext& context);

}  // namespace armtrue
