#include "fitter/model/state.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <regex>
#include <utility>

namespace armtrue {
namespace {

// A gravity regressor's name taken apart: kind 0 torque, 1 moment x, 2 moment y; joint 0 = base;
// link 0 = payload.
struct RegressorName {
  int kind, joint, link, component;
};

std::optional<RegressorName> parse_regressor(const std::string& name, int joints) {
  static const std::regex pattern(
      R"(u(x|y)?_([0-9]{1,2})_([0-9]{1,2})_([mxyz])|up(x|y)?_([0-9]{1,2}))");
  std::smatch match;
  if (name.empty() || name[0] != 'u' || !std::regex_match(name, match, pattern))
    return std::nullopt;
  RegressorName result{};
  const bool payload = match[6].matched;
  const std::string axis = match[payload ? 5 : 1];
  result.kind = axis.empty() ? 0 : (axis == "x" ? 1 : 2);
  result.joint = std::stoi(match[payload ? 6 : 2]);
  result.link = payload ? 0 : std::stoi(match[3]);
  result.component = payload ? 0 : static_cast<int>(std::string("mxyz").find(match[4].str()));
  if (result.joint > joints || result.link > joints || (result.joint == 0 && result.kind == 0))
    return std::nullopt;
  if (!payload && (result.link == 0 || result.link < result.joint)) return std::nullopt;
  return result;
}

int trailing_number(const std::string& name, const std::string& prefix) {
  if (name.rfind(prefix, 0) != 0 || name.size() == prefix.size() || name.size() > prefix.size() + 2)
    return 0;
  for (std::size_t i = prefix.size(); i < name.size(); ++i) {
    if (name[i] < '0' || name[i] > '9') return 0;
  }
  return std::stoi(name.substr(prefix.size()));
}

// What must be recorded, or stated of the arm, for the state variable `name`.
std::string what_is_missing(const std::string& name, const Robot& robot) {
  if (name == "dT")
    return "column temp_" + (robot.sensors.empty() ? "NAME" : robot.sensors.front());
  if (name.rfind("dT_", 0) == 0) return "column temp_" + name.substr(3);
  if (parse_regressor(name, robot.joint_count())) return "column payload";
  if (trailing_number(name, "tau"))
    return "column " + name + " (or mass and com of robot.yaml's links)";
  if (name == "bmx" || name == "bmy" || trailing_number(name, "gmx") ||
      trailing_number(name, "gmy"))
    return "mass and com of robot.yaml's links";
  return "column " + name;
}

// What a unit mass at a body's origin, or a unit first moment along one of its axes (which weighs
// nothing in total), exerts at one pose. `frames`: 1…n in the base, then the payload point's.
double regressor_at(const Robot& robot, const std::vector<Pose>& frames,
                    const RegressorName& what) {
  const int n = robot.joint_count();
  const std::size_t body = static_cast<std::size_t>(what.link == 0 ? n : what.link - 1);
  const Eigen::Vector3d g = robot.gravity;
  const bool unit_mass = what.component == 0;
  const Eigen::Vector3d force = unit_mass ? g : Eigen::Vector3d::Zero();
  const Eigen::Vector3d moment_at_base =
      unit_mass ? frames[body].translation().cross(g).eval()
                : frames[body].linear().col(what.component - 1).cross(g).eval();
  if (what.joint == 0) return what.kind == 1 ? moment_at_base.x() : moment_at_base.y();
  const auto about = [&](std::size_t k) -> Eigen::Vector3d {
    return frames[k].linear().transpose() * (moment_at_base - frames[k].translation().cross(force));
  };
  if (what.kind != 0) return about(static_cast<std::size_t>(what.joint - 1))[what.kind - 1];
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

// Readings must outnumber what explains them by this factor, and hold no more than this share of
// their variance beside it.
constexpr int kRowsPerTorqueRegressor = 5;
constexpr double kLargestUnexplainedTorque = 0.05;

State::State(const Robot& robot, Columns columns, const Eigen::Vector3d& payload_point)
    : robot_(&robot), columns_(std::move(columns)), payload_point_(payload_point) {
  const int n = robot.joint_count();
  for (int k = 1; k <= n; ++k) {
    const std::string name = "q" + std::to_string(k);
    if (!columns_.contains(name)) {
      throw ModelError("measurements: column " + name + " is missing, expected q1 to q" +
                       std::to_string(n));
    }
  }
  rows_ = columns_.at("q1").size();
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
    if (name.rfind("temp_", 0) != 0) continue;
    const std::string sensor = name.substr(5);
    if (std::find(sensors_.begin(), sensors_.end(), sensor) == sensors_.end())
      sensors_.push_back(sensor);
  }
}

State State::select(const std::vector<std::size_t>& rows) const {
  Columns chosen;
  for (const auto& [name, values] : columns_) {
    std::vector<double>& column = chosen[name];
    column.reserve(rows.size());
    for (const std::size_t row : rows) column.push_back(values[row]);
  }
  return State(*robot_, std::move(chosen), payload_point_);
}

bool State::has(const std::string& name) const {
  if (columns_.contains(name) && name != "repeat" && name != "target") return true;
  const int n = robot_->joint_count();
  const int th = trailing_number(name, "th");
  if (th >= 1 && th <= n) return true;
  if (name == "dT") return !sensors_.empty();
  if (name.rfind("dT_", 0) == 0) return columns_.contains("temp_" + name.substr(3));
  if (const auto regressor = parse_regressor(name, n))
    return regressor->link != 0 || columns_.contains("payload");
  const bool gravity = name == "bmx" || name == "bmy" || trailing_number(name, "tau") ||
                       trailing_number(name, "gmx") || trailing_number(name, "gmy");
  if (!gravity || robot_->links.empty()) return false;
  for (const char* prefix : {"tau", "gmx", "gmy"}) {
    if (trailing_number(name, prefix) > n) return false;
  }
  return true;
}

const std::vector<double>& State::remember(const std::string& name,
                                           std::vector<double> values) const {
  return derived_[name] = std::move(values);
}

const std::vector<double>& State::column(const std::string& name) const {
  const std::scoped_lock locked(lock_.mutex);
  if (const auto found = derived_.find(name); found != derived_.end()) return found->second;
  const int torque_of = trailing_number(name, "tau");
  const bool is_torque = torque_of >= 1 && torque_of <= robot_->joint_count();
  const auto recorded = columns_.find(name);
  // What is fitted must be what a device computes, so that statics come before a sensor.
  if (recorded != columns_.end() && !(is_torque && computes_torque())) {
    return is_torque ? remember(name, smooth_torque(torque_of, recorded->second))
                     : recorded->second;
  }
  if (!has(name)) {
    throw ModelError(what_is_missing(name, *robot_) +
                     " is missing, expected it as the model reads '" + name + "'");
  }
  const int n = robot_->joint_count();
  if (const int k = trailing_number(name, "th"); k >= 1) {
    std::vector<double> values(rows_, robot_->joints[static_cast<std::size_t>(k - 1)].offset);
    for (int j = 0; j < n; ++j) {
      const double c = robot_->coupling(k - 1, j);
      if (c == 0.0) continue;
      for (std::size_t i = 0; i < rows_; ++i)
        values[i] += c * q_[i * static_cast<std::size_t>(n) + static_cast<std::size_t>(j)];
    }
    return remember(name, std::move(values));
  }
  if (name == "dT") return column("dT_" + sensors_.front());
  if (name.rfind("dT_", 0) == 0) {
    std::vector<double> values = columns_.at("temp_" + name.substr(3));
    for (double& v : values) v -= robot_->temperature_reference;
    return remember(name, std::move(values));
  }
  if (parse_regressor(name, n)) return remember(name, compute_regressor(name));
  compute_gravity();
  return derived_.at(name);
}

State::Frames State::frames_of_row(std::size_t row) const {
  const int n = robot_->joint_count();
  Frames frames;
  frames.reserve(static_cast<std::size_t>(n) + 1);
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

void State::compute_gravity() const {
  const int n = robot_->joint_count();
  const auto count = static_cast<std::size_t>(n);
  std::vector<std::vector<double>> tau(count, std::vector<double>(rows_)), gmx = tau, gmy = tau;
  std::vector<double> bmx(rows_), bmy(rows_);
  const std::vector<double>* payload =
      columns_.contains("payload") ? &columns_.at("payload") : nullptr;
  Eigen::VectorXd link_torque(n);
  for (std::size_t row = 0; row < rows_; ++row) {
    const Frames frames = frames_of_row(row);
    // From the tip inwards: weight beyond joint k and its moment about the base origin.
    const double payload_mass = payload ? (*payload)[row] : 0.0;
    Eigen::Vector3d force = payload_mass * robot_->gravity;
    Eigen::Vector3d moment_at_base = frames[count].translation().cross(force);
    for (int k = n - 1; k >= 0; --k) {
      const auto i = static_cast<std::size_t>(k);
      const Link& link = robot_->links[i];
      const Eigen::Vector3d weight = link.mass * robot_->gravity;
      force += weight;
      moment_at_base += (frames[i] * link.com_in_frame).cross(weight);
      const Eigen::Vector3d moment = moment_at_base - frames[i].translation().cross(force);
      const Eigen::Vector3d in_frame = frames[i].linear().transpose() * moment;
      gmx[i][row] = in_frame.x();
      gmy[i][row] = in_frame.y();
      link_torque[k] =
          robot_->joints[i].prismatic ? frames[i].linear().col(2).dot(force) : in_frame.z();
    }
    bmx[row] = moment_at_base.x();
    bmy[row] = moment_at_base.y();
    const Eigen::VectorXd motor_torque = robot_->coupling.transpose() * link_torque;
    for (std::size_t k = 0; k < count; ++k)
      tau[k][row] = motor_torque[static_cast<Eigen::Index>(k)];
  }
  for (std::size_t k = 0; k < count; ++k) {
    const std::string number = std::to_string(k + 1);
    remember("tau" + number, std::move(tau[k]));
    remember("gmx" + number, std::move(gmx[k]));
    remember("gmy" + number, std::move(gmy[k]));
  }
  remember("bmx", std::move(bmx));
  remember("bmy", std::move(bmy));
}

// A torque sensor's noise would pass for deflection, and weaken every spring that is fitted to it.
// At rest a joint's torque is linear in the arm's gravity regressors, a constant, and friction in
// the direction of approach: where those explain the readings, what they explain is used.
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
  Eigen::ColPivHouseholderQR<Eigen::MatrixXd> qr;
  qr.setThreshold(1e-8);
  qr.compute(a);
  const Eigen::VectorXd smooth = a * qr.solve(b);
  const double spread = (b.array() - b.mean()).square().sum();
  if ((b - smooth).squaredNorm() > kLargestUnexplainedTorque * spread) return measured;
  return {smooth.data(), smooth.data() + rows};
}

std::vector<double> State::compute_regressor(const std::string& name) const {
  const int n = robot_->joint_count();
  const RegressorName asked = *parse_regressor(name, n);
  // Those of one joint are asked for together, and the frames of a row cost more than all of them.
  std::vector<std::pair<std::string, RegressorName>> wanted{{name, asked}};
  if (asked.link != 0) {
    const std::string stem = name.substr(0, name.find('_', name.find('_') + 1) + 1);
    for (int link = 1; link <= n; ++link) {
      for (const char* component : {"_m", "_x", "_y", "_z"}) {
        const std::string other = stem + std::to_string(link) + component;
        const auto what = parse_regressor(other, n);
        if (what && other != name && !derived_.contains(other)) wanted.emplace_back(other, *what);
      }
    }
  }
  std::vector<std::vector<double>> values(wanted.size(), std::vector<double>(rows_));
  for (std::size_t row = 0; row < rows_; ++row) {
    const Frames frames = frames_of_row(row);
    for (std::size_t w = 0; w < wanted.size(); ++w)
      values[w][row] = regressor_at(*robot_, frames, wanted[w].second);
  }
  for (std::size_t w = 1; w < wanted.size(); ++w) remember(wanted[w].first, std::move(values[w]));
  return std::move(values.front());
}

}  // namespace armtrue
