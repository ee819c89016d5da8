#include "fitter/model/state.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <numeric>
#include <optional>
#include <utility>

#include "fitter/common/dense.h"

namespace armtrue {
namespace {

// Load at one pose of a unit mass at a body's origin, or of a unit first moment along one of its
// axes (of zero total weight). `frames`: 1…n in the base, then the payload point's.
double regressor_at(const Robot& robot, const std::vector<Pose>& frames, const Variable& what) {
  const int n = robot.joint_count();
  const std::size_t body = static_cast<std::size_t>(what.link == 0 ? n : what.link - 1);
  const Eigen::Vector3d g = robot.gravity;
  const bool unit_mass = what.component == 'm';
  const Eigen::Vector3d force = unit_mass ? g : Eigen::Vector3d::Zero();
  const Eigen::Vector3d moment_at_base =
      unit_mass ? frames[body].translation().cross(g).eval()
                : frames[body].linear().col(what.component - 'x').cross(g).eval();
  if (what.joint == 0) return moment_at_base[what.axis];
  const auto about = [&](std::size_t k) -> Eigen::Vector3d {
    return frames[k].linear().transpose() * (moment_at_base - frames[k].translation().cross(force));
  };
  if (what.kind == VariableKind::kMomentRegressor)
    return about(static_cast<std::size_t>(what.joint - 1))[what.axis];
  double torque = 0.0;
  for (int k = 0; k < n && k <= static_cast<int>(body); ++k) {
    const double c = robot.coupling(k, what.joint - 1);
    if (c == 0.0) continue;
    const auto i = static_cast<std::size_t>(k);
    torque += c * (robot.joints[i].prismatic ? frames[i].linear().col(2).dot(force) : about(i).z());
  }
  return torque;
}

}  // namespace

// A recorded torque is smoothed if rows outnumber the regressors by this factor, and these leave no
// more than this share of its variance.
constexpr int kRowsPerTorqueRegressor = 5;
constexpr double kLargestUnexplainedTorque = 0.05;

State::State(const Robot& robot, Columns columns, const Eigen::Vector3d& payload_point)
    : robot_(&robot), columns_(std::move(columns)), payload_point_(payload_point) {
  const int n = robot.joint_count();
  for (int k = 1; k <= n; ++k) {
    const std::string name = "q" + std::to_string(k);
    if (!columns_.contains(name) && !robot.is_passive(k)) {
      throw ModelError("measurements: column " + name + " is missing, expected q1 to q" +
                       std::to_string(n));
    }
    if (!robot.is_passive(k)) rows_ = columns_.at(name).size();
  }
  for (int k = 1; k <= n; ++k) {
    if (robot.is_passive(k)) columns_["q" + std::to_string(k)].assign(rows_, 0.0);
  }
  for (const auto& [name, values] : columns_) {
    if (values.size() != rows_) {
      throw ModelError("measurements: column " + name + " has " + std::to_string(values.size()) +
                       " rows, expected " + std::to_string(rows_));
    }
  }
  q_.resize(rows_ * static_cast<std::size_t>(n));
  for (int k = 0; k < n; ++k) {
    const std::vector<double>& q = columns_.at("q" + std::to_string(k + 1));
    for (std::size_t i = 0; i < rows_; ++i)
      q_[i * static_cast<std::size_t>(n) + static_cast<std::size_t>(k)] = q[i];
  }
  for (const std::string& sensor : robot.sensors) {
    if (columns_.contains("temp_" + sensor)) sensors_.push_back(sensor);
  }
  for (const auto& [name, values] : columns_) {
    if (name.starts_with("temp_") && std::ranges::find(sensors_, name.substr(5)) == sensors_.end())
      sensors_.push_back(name.substr(5));
  }
}

std::vector<double> State::values(const Expression& basis) const {
  return basis.evaluate(rows_, std::bind_front(&State::column, this));
}

void State::stand(std::vector<Pose> frames) {
  standing_ = std::make_shared<const Frames>(std::move(frames));
  forget_loads();
}

void State::let_loads_follow(bool follow) {
  loads_follow_ = follow;
  standing_.reset();
  forget_loads();
}

void State::forget_loads() {
  const int n = robot_->joint_count();
  std::erase_if(derived_, [&](const auto& column) {
    const std::optional<Variable> v = parse_variable(column.first, n);
    return v && is_load(*v);
  });
}

bool State::is_load(const Variable& v) const {
  return v.is_load() && (v.kind != VariableKind::kTorque || computes_torque());
}

bool State::is_load(const Expression& basis) const {
  return std::ranges::any_of(basis.variables(), [&](const std::string& name) {
    const std::optional<Variable> v = parse_variable(name, robot_->joint_count());
    return v && is_load(*v);
  });
}

void State::begin_time_at(double origin) {
  time_origin_ = origin;
  const auto clock = columns_.find("time");
  if (clock == columns_.end() || origin == 0.0) return;
  std::vector<double> values = clock->second;
  for (double& v : values) v -= origin;
  remember("time", std::move(values));
}

bool State::has(const std::string& name) const {
  const std::optional<Variable> v = parse_variable(name, robot_->joint_count());
  if (!v) return columns_.contains(name) && name != "repeat" && name != "target";
  switch (v->kind) {
    case VariableKind::kLinkAngle:
      return true;
    case VariableKind::kTemperature:
      return v->sensor.empty() ? !sensors_.empty() : columns_.contains("temp_" + v->sensor);
    case VariableKind::kTorqueRegressor:
    case VariableKind::kMomentRegressor:
      return v->link != 0 || columns_.contains("payload");
    case VariableKind::kTorque:
    case VariableKind::kMoment:
    case VariableKind::kBaseMoment:
      return computes_torque() || columns_.contains(name);
    case VariableKind::kTorqueTilt:
    case VariableKind::kMomentTilt:
      return computes_torque();
    case VariableKind::kWarmth:
      return columns_.contains(name) ||
             (columns_.contains("time") && columns_.contains(v->source()));
    default:
      return columns_.contains(name);
  }
}

const std::vector<double>& State::remember(const std::string& name,
                                           std::vector<double> values) const {
  return derived_[name] = std::move(values);
}

const std::vector<double>& State::column(const std::string& name) const {
  const std::scoped_lock locked(lock_.mutex);
  if (const auto found = derived_.find(name); found != derived_.end()) return found->second;
  const int n = robot_->joint_count();
  const std::optional<Variable> v = parse_variable(name, n);
  const auto recorded = columns_.find(name);
  // A fit must use the torque that a device computes, so statics take precedence over a sensor.
  const bool is_computed = v && v->kind == VariableKind::kTorque && computes_torque();
  if (recorded != columns_.end() && !is_computed) return recorded->second;
  for (int k = 1; k <= n; ++k) {
    if (name == motion_of(k)) return remember(name, motion(k));
  }
  if (!v || !has(name)) {
    throw ModelError(what_is_missing(name, *robot_) +
                     " is missing, expected it as the model reads '" + name + "'");
  }
  switch (v->kind) {
    case VariableKind::kLinkAngle:
      return remember(name, link_angle(v->joint));
    case VariableKind::kTemperature: {
      if (v->sensor.empty()) return column("dT_" + sensors_.front());
      std::vector<double> values = columns_.at("temp_" + v->sensor);
      for (double& value : values) value -= robot_->temperature_reference;
      return remember(name, std::move(values));
    }
    case VariableKind::kTorqueRegressor:
    case VariableKind::kMomentRegressor:
      return remember(name, compute_regressor(*v));
    case VariableKind::kWarmth:
      return remember(name, warmth(*v));
    case VariableKind::kTorqueTilt:
    case VariableKind::kMomentTilt: {
      // Loads are linear in gravity, and a small turn of the base about an axis e changes gravity
      // in the base frame by g x e per radian.
      const std::string end = std::string("_") + v->component;
      compute_loads(robot_->gravity.cross(Eigen::Vector3d::Unit(v->component - 'x')),
                    {"tilt_", "tiltx_", "tilty_", "tiltx_0" + end, "tilty_0" + end, end});
      return derived_.at(name);
    }
    default:
      compute_loads(robot_->gravity, {"tau", "gmx", "gmy", "bmx", "bmy", ""});
      return derived_.at(name);
  }
}

std::vector<std::size_t> State::measured_order() const {
  std::vector<std::size_t> order(rows_);
  std::iota(order.begin(), order.end(), std::size_t{0});
  if (const auto clock = columns_.find("time"); clock != columns_.end())
    std::ranges::stable_sort(order, {}, [&](std::size_t row) { return clock->second[row]; });
  return order;
}

std::vector<double> State::motion(int joint) const {
  constexpr double kStandstill = 1e-6;  // [rad or m]
  const std::vector<std::size_t> order = measured_order();
  const std::vector<double>& q = columns_.at("q" + std::to_string(joint));
  std::vector<double> side(rows_, 0.0);
  for (std::size_t i = 1; i < rows_; ++i) {
    const double step = q[order[i]] - q[order[i - 1]];
    side[order[i]] = std::abs(step) > kStandstill ? std::copysign(1.0, step) : side[order[i - 1]];
  }
  return side;
}

std::vector<double> State::link_angle(int joint) const {
  const auto n = static_cast<std::size_t>(robot_->joint_count());
  std::vector<double> values(rows_, robot_->joints[static_cast<std::size_t>(joint - 1)].offset);
  for (std::size_t j = 0; j < n; ++j) {
    const double c = robot_->coupling(joint - 1, static_cast<Eigen::Index>(j));
    if (c == 0.0) continue;
    for (std::size_t i = 0; i < rows_; ++i) values[i] += c * q_[i * n + j];
  }
  return values;
}

// The value of a row (duty or temperature) acts since the row before. A session begins with a joint
// that has rested, or with a gear as warm as the thermometer.
std::vector<double> State::warmth(const Variable& v) const {
  const std::vector<double>& time = columns_.at("time");
  const std::vector<double>& source = columns_.at(v.source());
  const double zero = v.sensor.empty() ? 0.0 : robot_->temperature_reference;
  const std::vector<std::size_t> order = measured_order();
  std::vector<double> values(rows_);
  double warm = v.sensor.empty() || rows_ == 0 ? 0.0 : source[order.front()] - zero;
  double before = rows_ > 0 ? time[order.front()] : 0.0;
  for (const std::size_t i : order) {
    const double kept = std::exp(-(time[i] - before) / v.tau);
    warm = kept * warm + (1.0 - kept) * (source[i] - zero);
    values[i] = warm;
    before = time[i];
  }
  return values;
}

State::Frames State::frames_of_row(std::size_t row) const {
  const int n = robot_->joint_count();
  const auto each = static_cast<std::size_t>(n) + 1;
  if (standing_) {
    const auto first = standing_->begin() + static_cast<std::ptrdiff_t>(row * each);
    return {first, first + static_cast<std::ptrdiff_t>(each)};
  }
  Frames frames;
  frames.reserve(each);
  Pose pose = Pose::Identity();
  for (int k = 0; k < n; ++k) {
    const Joint& joint = robot_->joints[static_cast<std::size_t>(k)];
    double angle = joint.offset;
    for (int j = 0; j < n; ++j) {
      angle += robot_->coupling(k, j) *
               q_[row * static_cast<std::size_t>(n) + static_cast<std::size_t>(j)];
    }
    pose = pose * joint.fixed;
    if (joint.prismatic) {
      pose.translate(Eigen::Vector3d(0.0, 0.0, angle));
    } else {
      pose.rotate(Eigen::AngleAxisd(angle, Eigen::Vector3d::UnitZ()));
    }
    frames.push_back(pose);
  }
  frames.push_back(pose * robot_->end * Eigen::Translation3d(payload_point_));
  return frames;
}

void State::compute_loads(const Eigen::Vector3d& gravity, const LoadNames& names) const {
  const auto count = robot_->joints.size();
  const auto columns = [&](const std::string& stem) {
    std::vector<std::vector<double>*> result;
    for (std::size_t k = 1; k <= count; ++k) {
      result.push_back(&derived_[stem + std::to_string(k) + names.end]);
      result.back()->resize(rows_);
    }
    return result;
  };
  const auto torque = columns(names.torque);
  const auto moment_x = columns(names.moment_x), moment_y = columns(names.moment_y);
  std::vector<double>&base_x = derived_[names.base_x], &base_y = derived_[names.base_y];
  base_x.resize(rows_);
  base_y.resize(rows_);
  const std::vector<double>* payload =
      columns_.contains("payload") ? &columns_.at("payload") : nullptr;
  Eigen::VectorXd link_torque(robot_->joint_count());
  for (std::size_t row = 0; row < rows_; ++row) {
    const Frames frames = frames_of_row(row);
    // From the tip inwards: the weight beyond joint k and its moment about the base origin.
    const double payload_mass = payload ? (*payload)[row] : 0.0;
    Eigen::Vector3d force = payload_mass * gravity;
    Eigen::Vector3d moment_at_base = frames[count].translation().cross(force);
    for (std::size_t k = count; k-- > 0;) {
      const Link& link = robot_->links[k];
      const Eigen::Vector3d weight = link.mass * gravity;
      force += weight;
      moment_at_base += (frames[k] * link.com_in_frame).cross(weight);
      const Eigen::Vector3d moment = moment_at_base - frames[k].translation().cross(force);
      const Eigen::Vector3d in_frame = frames[k].linear().transpose() * moment;
      (*moment_x[k])[row] = in_frame.x();
      (*moment_y[k])[row] = in_frame.y();
      link_torque[static_cast<Eigen::Index>(k)] =
          robot_->joints[k].prismatic ? frames[k].linear().col(2).dot(force) : in_frame.z();
    }
    base_x[row] = moment_at_base.x();
    base_y[row] = moment_at_base.y();
    const Eigen::VectorXd motor_torque = robot_->coupling.transpose() * link_torque;
    for (std::size_t k = 0; k < count; ++k)
      (*torque[k])[row] = motor_torque[static_cast<Eigen::Index>(k)];
  }
}

void State::smooth_torques() {
  if (computes_torque()) return;
  for (int joint = 1; joint <= robot_->joint_count(); ++joint) {
    const std::string name = "tau" + std::to_string(joint);
    if (const auto recorded = columns_.find(name); recorded != columns_.end())
      remember(name, smooth_torque(joint, recorded->second));
  }
}

// At rest a joint's torque is linear in the arm's gravity regressors, a constant, and friction in
// the direction of approach. If these explain the readings, the fitted torque replaces them.
std::vector<double> State::smooth_torque(int joint, const std::vector<double>& measured) const {
  std::vector<const std::vector<double>*> used;
  const auto offer = [&](const std::vector<double>& values) {
    const auto [low, high] = std::minmax_element(values.begin(), values.end());
    if (*high - *low > 1e-9) used.push_back(&values);
  };
  const std::string k = std::to_string(joint);
  for (int link = joint; link <= robot_->joint_count(); ++link) {
    for (const char* component : {"_m", "_x", "_y", "_z"})
      offer(column("u_" + k + "_" + std::to_string(link) + component));
  }
  std::vector<double> payload_moment;
  if (columns_.contains("payload")) {
    payload_moment = column("up_" + k);
    for (std::size_t i = 0; i < rows_; ++i) payload_moment[i] *= columns_.at("payload")[i];
    offer(payload_moment);
  }
  if (columns_.contains("dir" + k)) offer(column("dir" + k));
  const auto rows = static_cast<Eigen::Index>(rows_);
  const auto count = static_cast<Eigen::Index>(used.size()) + 1;
  if (rows < kRowsPerTorqueRegressor * count) return measured;
  Eigen::MatrixXd a(rows, count);
  a.col(0).setOnes();
  for (Eigen::Index c = 1; c < count; ++c) {
    a.col(c) =
        Eigen::Map<const Eigen::VectorXd>(used[static_cast<std::size_t>(c - 1)]->data(), rows);
    a.col(c) /= a.col(c).cwiseAbs().maxCoeff();
  }
  const Eigen::Map<const Eigen::VectorXd> b(measured.data(), rows);
  const Eigen::VectorXd smooth = a * least_squares(a, b, 1e-8);
  const double spread = (b.array() - b.mean()).square().sum();
  if ((b - smooth).squaredNorm() > kLargestUnexplainedTorque * spread) return measured;
  return {smooth.data(), smooth.data() + rows};
}

std::vector<double> State::compute_regressor(const Variable& asked) const {
  const int n = robot_->joint_count();
  // Regressors of one joint are requested together, and a row's frames cost more than all of them.
  std::vector<Variable> wanted{asked};
  if (asked.link != 0) {
    const std::string stem =
        asked.name.substr(0, asked.name.find('_', asked.name.find('_') + 1) + 1);
    for (int link = 1; link <= n; ++link) {
      for (const char* component : {"_m", "_x", "_y", "_z"}) {
        const auto other = parse_variable(stem + std::to_string(link) + component, n);
        if (other && other->kind == asked.kind && other->name != asked.name &&
            !derived_.contains(other->name))
          wanted.push_back(*other);
      }
    }
  }
  std::vector<std::vector<double>> values(wanted.size(), std::vector<double>(rows_));
  for (std::size_t row = 0; row < rows_; ++row) {
    const Frames frames = frames_of_row(row);
    for (std::size_t w = 0; w < wanted.size(); ++w)
      values[w][row] = regressor_at(*robot_, frames, wanted[w]);
  }
  for (std::size_t w = 1; w < wanted.size(); ++w) remember(wanted[w].name, std::move(values[w]));
  return std::move(values.front());
}

}  // namespace armtrue
