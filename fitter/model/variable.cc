#include "fitter/model/variable.h"

#include <algorithm>
#include <array>
#include <regex>

namespace armtrue {
namespace {

struct Stem {
  const char* name;
  VariableKind kind;
  int axis;
};

// Variables of one joint: a stem and the joint's number.
constexpr std::array<Stem, 7> kOfJoints{{{"q", VariableKind::kJoint, 0},
                                         {"th", VariableKind::kLinkAngle, 0},
                                         {"qr", VariableKind::kReadBack, 0},
                                         {"tau", VariableKind::kTorque, 0},
                                         {"gmx", VariableKind::kMoment, 0},
                                         {"gmy", VariableKind::kMoment, 1},
                                         {"dir", VariableKind::kDirection, 0}}};
// Variables of the whole arm.
constexpr std::array<Stem, 4> kOfArm{{{"bmx", VariableKind::kBaseMoment, 0},
                                      {"bmy", VariableKind::kBaseMoment, 1},
                                      {"payload", VariableKind::kPayload, 0},
                                      {"time", VariableKind::kTime, 0}}};
// Columns that are measured or organise the measurements, and are no cause of an error.
constexpr std::array<const char*, 10> kNoState{"x",  "y",  "z",      "qw",     "qx",
                                               "qy", "qz", "repeat", "target", "sigma"};

// The number behind a stem; 0 where there is none.
int number_behind(const std::string& name, const std::string& stem) {
  if (!name.starts_with(stem) || name.size() == stem.size() || name.size() > stem.size() + 2)
    return 0;
  const std::string digits = name.substr(stem.size());
  return digits.find_first_not_of("0123456789") == std::string::npos ? std::stoi(digits) : 0;
}

bool is_regressor(const Variable& v) {
  return v.kind == VariableKind::kTorqueRegressor || v.kind == VariableKind::kMomentRegressor;
}

// The submatches of a name that has this stem and this form; nullopt for another name.
std::optional<std::smatch> parts_of(const std::string& name, const char* stem,
                                    const std::regex& form) {
  std::smatch parts;
  if (!name.starts_with(stem) || !std::regex_match(name, parts, form)) return std::nullopt;
  return parts;
}

std::optional<Variable> parse_regressor(const std::string& name, int joints) {
  static const std::regex pattern(
      R"(u(x|y)?_([0-9]{1,2})_([0-9]{1,2})_([mxyz])|up(x|y)?_([0-9]{1,2}))");
  const std::optional<std::smatch> found = parts_of(name, "u", pattern);
  if (!found) return std::nullopt;
  const std::smatch& match = *found;
  const bool payload = match[6].matched;
  const std::string axis = match[payload ? 5 : 1];
  Variable v;
  v.name = name;
  v.kind = axis.empty() ? VariableKind::kTorqueRegressor : VariableKind::kMomentRegressor;
  v.axis = axis == "y" ? 1 : 0;
  v.joint = std::stoi(match[payload ? 6 : 2]);
  v.link = payload ? 0 : std::stoi(match[3]);
  v.component = payload ? 'm' : match[4].str().front();
  if (v.joint > joints || v.link > joints || (v.joint == 0 && axis.empty())) return std::nullopt;
  if (!payload && (v.link == 0 || v.link < v.joint)) return std::nullopt;
  return v;
}

// tilt_K_C: torque on motor joint K per radian that the base is turned about its axis C;
// tiltx_K_C, tilty_K_C: the moment about x and y of frame K, or of the base (K = 0).
std::optional<Variable> parse_tilt(const std::string& name, int joints) {
  static const std::regex pattern(R"(tilt(x|y)?_([0-9]{1,2})_([xy]))");
  const std::optional<std::smatch> found = parts_of(name, "tilt", pattern);
  if (!found) return std::nullopt;
  const std::smatch& match = *found;
  Variable v;
  v.name = name;
  v.kind = match[1].matched ? VariableKind::kMomentTilt : VariableKind::kTorqueTilt;
  v.axis = match[1].str() == "y" ? 1 : 0;
  v.joint = std::stoi(match[2]);
  v.component = match[3].str().front();
  if (v.joint > joints || (v.joint == 0 && !match[1].matched)) return std::nullopt;
  return v;
}

// warmK_TAU: duty of joint K, and lagTAU_NAME: temperature NAME, low-passed with TAU seconds.
std::optional<Variable> parse_warmth(const std::string& name, int joints) {
  static const std::regex duty(R"(warm([0-9]{1,2})_([0-9]{1,7}))");
  static const std::regex temperature(R"(lag([0-9]{1,7})_(.+))");
  Variable v;
  v.name = name;
  v.kind = VariableKind::kWarmth;
  if (const auto of_duty = parts_of(name, "warm", duty)) {
    v.joint = std::stoi((*of_duty)[1]);
    v.tau = std::stod((*of_duty)[2]);
    if (v.joint < 1 || v.joint > joints) return std::nullopt;
  } else if (const auto of_sensor = parts_of(name, "lag", temperature)) {
    v.tau = std::stod((*of_sensor)[1]);
    v.sensor = (*of_sensor)[2];
  }
  if (!(v.tau > 0.0)) return std::nullopt;
  return v;
}

}  // namespace

std::string Variable::source() const {
  return sensor.empty() ? "duty" + std::to_string(joint) : "temp_" + sensor;
}

bool Variable::is_of_session() const {
  return kind == VariableKind::kTime || kind == VariableKind::kTemperature ||
         kind == VariableKind::kWarmth;
}

std::optional<Variable> parse_variable(const std::string& name, int joints) {
  Variable v;
  v.name = name;
  for (const Stem& stem : kOfArm) {
    if (name != stem.name) continue;
    v.kind = stem.kind;
    v.axis = stem.axis;
    return v;
  }
  for (const Stem& stem : kOfJoints) {
    const int joint = number_behind(name, stem.name);
    if (joint == 0) continue;
    if (joint > joints) return std::nullopt;
    v.kind = stem.kind;
    v.axis = stem.axis;
    v.joint = joint;
    return v;
  }
  if (name == "dT" || name.starts_with("dT_")) {
    v.kind = VariableKind::kTemperature;
    v.sensor = name == "dT" ? "" : name.substr(3);
    return v;
  }
  if (const auto regressor = parse_regressor(name, joints)) return regressor;
  if (const auto tilt = parse_tilt(name, joints)) return tilt;
  if (const auto warmth = parse_warmth(name, joints)) return warmth;
  if (name.starts_with("temp_") ||
      std::find(kNoState.begin(), kNoState.end(), name) != kNoState.end())
    return std::nullopt;
  return v;
}

std::vector<Variable> state_variables(int joints, const std::vector<std::string>& sensors) {
  std::vector<std::string> names;
  for (const Stem& stem : kOfJoints) {
    for (int k = 1; k <= joints; ++k) names.push_back(stem.name + std::to_string(k));
  }
  for (const char* stem : {"u", "ux", "uy"}) {
    for (int k = stem[1] ? 0 : 1; k <= joints; ++k) {
      for (int link = std::max(k, 1); link <= joints; ++link) {
        for (const char* component : {"_m", "_x", "_y", "_z"}) {
          names.push_back(stem + ("_" + std::to_string(k)) + "_" + std::to_string(link) +
                          component);
        }
      }
    }
  }
  for (const char* stem : {"up", "upx", "upy"}) {
    for (int k = stem[2] ? 0 : 1; k <= joints; ++k)
      names.push_back(stem + ("_" + std::to_string(k)));
  }
  for (const std::string stem : {"tilt_", "tiltx_", "tilty_"}) {
    for (int k = stem[4] == '_' ? 1 : 0; k <= joints; ++k) {
      for (const char* about : {"_x", "_y"}) names.push_back(stem + std::to_string(k) + about);
    }
  }
  for (const Stem& stem : kOfArm) names.push_back(stem.name);
  names.push_back("dT");
  for (const std::string& sensor : sensors) names.push_back("dT_" + sensor);
  std::vector<Variable> result;
  for (const std::string& name : names) result.push_back(*parse_variable(name, joints));
  return result;
}

std::vector<std::string> columns_of(const Variable& v, const Robot& robot, bool with_payload) {
  switch (v.kind) {
    case VariableKind::kJoint:
    case VariableKind::kLinkAngle:
      return {};
    case VariableKind::kTemperature:
      if (!v.sensor.empty()) return {"temp_" + v.sensor};
      return {"temp_" + (robot.sensors.empty() ? "NAME" : robot.sensors.front())};
    case VariableKind::kWarmth:
      return {"time", v.source()};
    default:
      break;
  }
  if (!v.is_load() || (v.kind == VariableKind::kTorque && robot.links.empty())) return {v.name};
  const bool changes_with_payload = !is_regressor(v) || v.link == 0;
  if (changes_with_payload && with_payload) return {"payload"};
  return {};
}

std::string what_is_missing(const std::string& name, const Robot& robot) {
  const std::optional<Variable> v = parse_variable(name, robot.joint_count());
  if (v && v->kind == VariableKind::kTorque)
    return "column " + name + " (or mass and com of robot.yaml's links)";
  if (v && v->is_load())
    return is_regressor(*v) ? "column payload" : "mass and com of robot.yaml's links";
  if (v && v->kind == VariableKind::kTemperature)
    return "column " + columns_of(*v, robot, false).front();
  return "column " + name;
}

std::string to_string(VariableKind kind) {
  constexpr std::array kNames{"joint",       "link_angle",  "read_back",        "torque",
                              "moment",      "base_moment", "torque_regressor", "moment_regressor",
                              "torque_tilt", "moment_tilt", "temperature",      "payload",
                              "direction",   "time",        "warmth",           "column"};
  return kNames.at(static_cast<std::size_t>(kind));
}

}  // namespace armtrue
