// Terms and parameters: what an effect contributes to a model.
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <vector>

#include "fitter/model/coordinate.h"
#include "fitter/model/expression/expression.h"

namespace armtrue {

/// Place of a term in a table: a node of a piecewise-linear table or of a multilinear grid.
struct TableReference {
  struct Axis {
    std::string variable;
    std::vector<double> nodes;
  };
  std::string id;
  std::vector<Axis> axes;
  std::vector<int> index;
};

/// A term proportional to a load that other terms of its model carry: basis = load · ratio. The
/// basis holds the load as it was when the model was built.
struct Follows {
  std::string load;  ///< CarriedLoad::torque of the effects that carry it
  Expression ratio = Expression::number(0.0);
};

/// weight · basis(state), on one coordinate.
struct Term {
  Coordinate coordinate;
  Expression basis = Expression::number(1.0);
  double weight = 1.0;
  std::optional<TableReference> table = std::nullopt;
  std::optional<Follows> follows = std::nullopt;
};

/// One coefficient and the terms that it drives.
struct Parameter {
  std::string name;         ///< "gear_harmonics[3].sin1"
  std::string effect;       ///< effect id
  std::vector<int> joints;  ///< 1-based
  std::string unit;         ///< of the coefficient: "rad", "rad/Nm", …
  double bound = 0.0;       ///< largest magnitude that is physical; the diagnosis refuses more
  double usual = 0.0;  ///< magnitude on real arms; 0: unknown. Of equal candidates the usual wins
  int sign = 0;  ///< +1 where only positive values are physical (a spring yields), 0 where both are
  double sign_doubt = 0.0;  ///< prior probability of the other sign
  bool alike = false;       ///< by design equal to the other coefficients of its effect
  double prior_mean = 0.0;
  double prior_sigma = 0.0;  ///< weak prior; 0: none
  bool exported = true;      ///< false where it belongs to the measurement and not to the arm
  bool fixed = false;        ///< held at prior_mean by the user
  std::vector<Term> terms;
  double value = 0.0;

  /// Whether values beyond the prior are possible, such as masses of another version of the arm.
  bool may_be_unusual() const { return usual > 0.0 && prior_sigma < bound; }
};

/// A parameter inside expressions: a time constant, an order, a phase.
struct NonlinearParameter {
  std::string name;  ///< unique, as in the expressions: "warm_up_tau"
  std::string effect;
  std::vector<int> joints;
  std::string unit;
  double value = 0.0, lower = 0.0, upper = 0.0;
  std::vector<double> starts;  ///< values tried before the descent; empty: only the initial value
  std::string option = {};     ///< option of the effect's request that it replaces; empty: none
};

/// Quadratic penalty Σ (row · values)² / σ² on parameters: smoothness and gauges of tables.
struct Penalty {
  std::vector<std::pair<std::string, double>> row;  ///< parameter name, factor
  double sigma = 1.0;
  bool smoothness = false;  ///< true: strength may be chosen from the data; false: a fixed gauge
  std::string
      only_with;  ///< applies if this parameter is there to carry what it removes; empty: always
};

/// What one effect contributes to a model.
struct EffectTerms {
  std::vector<Parameter> parameters;
  std::vector<NonlinearParameter> nonlinear;
  std::vector<Penalty> penalties;
};

nlohmann::json to_json(const Term& term, int targets);
Term term_from_json(const nlohmann::json& value, int joints, int targets);
nlohmann::json to_json(const Parameter& parameter, int targets);

}  // namespace armtrue
