// The variables of the state (docs/model.md): what each is, and what a file must hold for it. Their
// names are parsed only here.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "fitter/model/robot.h"

namespace armtrue {

enum class VariableKind {
  kJoint,
  kLinkAngle,
  kReadBack,
  kTorque,  // gravity's loads: from here
  kMoment,
  kBaseMoment,
  kTorqueRegressor,
  kMomentRegressor,
  kTorqueTilt,
  kMomentTilt,  // to here
  kTemperature,
  kPayload,
  kDirection,
  kTime,
  kWarmth,  ///< of a gear: its duty, or a temperature, low-passed
  kColumn   ///< any other numeric column, under its own name
};

/// One state variable, parsed from its name.
struct Variable {
  VariableKind kind = VariableKind::kColumn;
  std::string name;
  int joint = 0;         ///< 1-based; 0: none, or the base
  int axis = 0;          ///< of moments: 0 about x, 1 about y
  int link = 0;          ///< of regressors: the body; 0: the payload
  char component = 'm';  ///< of regressors: m, or x, y, z of mass times centre; of tilts: x or y
  std::string sensor;    ///< of temperatures: empty for the first sensor; of warmth: empty for duty
  double tau = 0.0;      ///< of warmth: time constant [s]

  /// Of warmth: the column that is low-passed.
  std::string source() const;
  /// True for gravity's loads: torques, moments, their regressors, and their changes by a tilt.
  bool is_load() const {
    return kind >= VariableKind::kTorque && kind <= VariableKind::kMomentTilt;
  }
  /// True for angles and loads, which the arm's posture determines.
  bool is_of_posture() const { return kind <= VariableKind::kMomentTilt; }
  /// True for what changes slowly over a session: time, temperatures, a gear's warm-up.
  bool is_of_session() const;
};

/// Parses a name: a variable of the state, or any other column (kColumn). nullopt for columns that
/// are no state (x, y, z, …, repeat, target, sigma) and for joints that the arm does not have.
std::optional<Variable> parse_variable(const std::string& name, int joints);

/// All variables that the state of an arm with `joints` joints and these temperature sensors can
/// have, in the order of docs/model.md.
std::vector<Variable> state_variables(int joints, const std::vector<std::string>& sensors);

/// Columns of a file that the variable needs on this arm; `with_payload`: the measurements had a
/// payload.
std::vector<std::string> columns_of(const Variable& variable, const Robot& robot,
                                    bool with_payload);

/// In words: what must be recorded, or stated of the arm, for the variable `name`.
std::string what_is_missing(const std::string& name, const Robot& robot);

/// "joint", "link_angle", …: a kind's name in JSON.
std::string to_string(VariableKind kind);

}  // namespace armtrue
