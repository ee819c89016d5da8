#include "fitter/plan/cell.h"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <numbers>
#include <random>

#include "fitter/common/observer.h"
#include "fitter/plan/exchange.h"

namespace armtrue {
namespace {

using nlohmann::json;

constexpr double kMargin = 0.02;  // of a joint's range, at each end
// A parallelogram's crank and lower arm must stay this far from lying in one line.
constexpr double kLinkageMargin = 35.0 * std::numbers::pi / 180.0;
// With fewer admissible poses than one in this many tries, the cell is practically closed.
constexpr std::size_t kMostTries = 2000;

Eigen::Vector3d vector_from(const json& value, const char* key) {
  const bool three =
      value.is_array() && value.size() == 3 &&
      std::all_of(value.begin(), value.end(), [](const json& v) { return v.is_number(); });
  if (!three)
    throw ModelError(std::string("cell: ") + key + " is " + value.dump() +
                     ", expected three numbers");
  return {value[0].get<double>(), value[1].get<double>(), value[2].get<double>()};
}

// Least distance between the segments a0–a1 and b0–b1: the unconstrained minimum of each parameter,
// clamped, in turn (Ericson, Real-Time Collision Detection, 5.1.9).
double segment_distance(const Eigen::Vector3d& a0, const Eigen::Vector3d& a1,
                        const Eigen::Vector3d& b0, const Eigen::Vector3d& b1) {
  const Eigen::Vector3d a = a1 - a0, b = b1 - b0, between = a0 - b0;
  const double aa = a.squaredNorm(), bb = b.squaredNorm(), ab = a.dot(b);
  const double ta = a.dot(between), tb = b.dot(between);
  constexpr double kPoint = 1e-18;
  double s = 0.0, t = 0.0;
  if (aa > kPoint) {
    const double determinant = aa * bb - ab * ab;
    s = determinant > kPoint ? std::clamp((ab * tb - ta * bb) / determinant, 0.0, 1.0) : 0.0;
  }
  if (bb > kPoint) t = std::clamp((ab * s + tb) / bb, 0.0, 1.0);
  if (aa > kPoint) s = std::clamp((ab * t - ta) / aa, 0.0, 1.0);
  return (between + s * a - t * b).norm();
}

bool seen(const std::vector<Pose>& frames, const Pose& tool, const Cell& cell) {
  const Eigen::Vector3d point = tool.translation();
  const Eigen::Vector3d sight = *cell.tracker - point;
  const double distance = sight.norm();
  if (distance <= cell.clearance) return false;
  if (cell.acceptance) {
    const Eigen::Vector3d opening = tool.linear() * cell.opening.normalized();
    if (opening.dot(sight) < std::cos(*cell.acceptance) * distance) return false;
  }
  // The flange is right beside the reflector, so the line of sight is tested from one clearance
  // away.
  const Eigen::Vector3d begin = point + sight * (cell.clearance / distance);
  Eigen::Vector3d from = Eigen::Vector3d::Zero();
  for (const Pose& frame : frames) {
    const Eigen::Vector3d to = frame.translation();
    if (segment_distance(begin, *cell.tracker, from, to) < cell.clearance) return false;
    from = to;
  }
  return true;
}

// True if every passive joint, whose position the couplings give, is within its limits.
bool passive_within_limits(const Robot& robot, const double* q) {
  for (int k = 0; k < robot.joint_count(); ++k) {
    const Joint& joint = robot.joints[static_cast<std::size_t>(k)];
    if (!joint.passive || !joint.limited) continue;
    double given = 0.0;
    for (int j = 0; j < robot.joint_count(); ++j) given += robot.coupling(k, j) * q[j];
    if (given < joint.lower || given > joint.upper) return false;
  }
  return true;
}

bool linkage_open(const Robot& robot, const double* q) {
  if (!robot.parallelogram) return true;
  const Parallelogram& bars = *robot.parallelogram;
  const int n = robot.joint_count();
  double beta = bars.angle + robot.joints[static_cast<std::size_t>(bars.arm_joint - 1)].offset;
  for (int j = 0; j < n; ++j) beta += robot.coupling(bars.arm_joint - 1, j) * q[j];
  return beta > kLinkageMargin && beta < std::numbers::pi - kLinkageMargin;
}

}  // namespace

Cell Cell::from_json(const json& content) {
  Cell cell;
  if (content.contains("box")) {
    const json& box = content["box"];
    if (!box.is_array() || box.size() != 3)
      throw ModelError("cell: box is " + box.dump() + ", expected three pairs");
    Eigen::AlignedBox3d limits;
    for (int c = 0; c < 3; ++c) {
      const json& pair = box[static_cast<std::size_t>(c)];
      const bool two =
          pair.is_array() && pair.size() == 2 && pair[0].is_number() && pair[1].is_number();
      if (!two || !(pair[0].get<double>() < pair[1].get<double>())) {
        throw ModelError("cell: box holds " + pair.dump() + ", expected a low and a higher number");
      }
      limits.min()[c] = pair[0].get<double>();
      limits.max()[c] = pair[1].get<double>();
    }
    cell.box = limits;
  }
  if (content.contains("floor")) cell.floor = content["floor"].get<double>();
  if (content.contains("tracker")) cell.tracker = vector_from(content["tracker"], "tracker");
  cell.clearance = content.value("clearance", cell.clearance);
  if (content.contains("acceptance")) cell.acceptance = content["acceptance"].get<double>();
  if (content.contains("opening")) cell.opening = vector_from(content["opening"], "opening");
  if (!(cell.clearance > 0.0)) throw ModelError("cell: clearance must be positive");
  if (cell.opening.norm() < 1e-9) throw ModelError("cell: opening is zero, expected a direction");
  return cell;
}

Eigen::MatrixX2d joint_ranges(const Robot& robot, const std::vector<double>& recorded) {
  const int n = robot.joint_count();
  Eigen::MatrixX2d ranges(n, 2);
  for (int k = 0; k < n; ++k) {
    const Joint& joint = robot.joints[static_cast<std::size_t>(k)];
    double low = -std::numbers::pi, high = std::numbers::pi;
    if (joint.passive) {
      low = high = 0.0;
    } else if (joint.limited) {
      low = joint.lower;
      high = joint.upper;
    } else if (!recorded.empty()) {
      low = high = recorded[static_cast<std::size_t>(k)];
      for (std::size_t at = static_cast<std::size_t>(k); at < recorded.size();
           at += static_cast<std::size_t>(n)) {
        low = std::min(low, recorded[at]);
        high = std::max(high, recorded[at]);
      }
    } else if (joint.prismatic) {
      throw ModelError("robot: joint " + std::to_string(k + 1) +
                       " slides and has no limits, expected limits: [lo, hi]");
    }
    const double margin = kMargin * (high - low);
    ranges.row(k) << low + margin, high - margin;
  }
  return ranges;
}

bool admissible(Kinematics& kinematics, const double* q, const Cell& cell) {
  if (!linkage_open(kinematics.robot(), q) || !passive_within_limits(kinematics.robot(), q))
    return false;
  const Eigen::VectorXd still = Eigen::VectorXd::Zero(kinematics.layout().size());
  const Pose tool = kinematics.forward(q, still.data(), 0);
  if (cell.box && !cell.box->contains(tool.translation())) return false;
  if (cell.floor) {
    if (tool.translation().z() < *cell.floor) return false;
    // Joint 1 is on the base, whose height does not depend on the pose.
    for (std::size_t k = 1; k < kinematics.frames().size(); ++k) {
      if (kinematics.frames()[k].translation().z() < *cell.floor) return false;
    }
  }
  return !cell.tracker || seen(kinematics.frames(), tool, cell);
}

Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor> reachable_poses(
    const Robot& robot, const Pose& flange_from_tool, const Cell& cell,
    const Eigen::MatrixX2d& ranges, Spread spread, std::size_t count, std::uint64_t seed) {
  const int n = robot.joint_count();
  Kinematics kinematics(robot, 1);
  kinematics.set_tool(0, flange_from_tool);
  Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor> poses(
      static_cast<Eigen::Index>(count), n);
  std::mt19937_64 generator(seed);
  std::vector<double> q(static_cast<std::size_t>(n));
  std::size_t tries = 0;
  for (std::size_t found = 0; found < count;) {
    throw_if_cancelled();
    if (++tries > kMostTries * (found + 1)) {
      throw ModelError("plan: hardly any pose is within the joint limits and the cell given (" +
                       std::to_string(found) + " of " + std::to_string(tries - 1) + " tries)");
    }
    for (int k = 0; k < n; ++k) {
      double share = uniform(generator);
      if (spread == Spread::kEdges && share < 0.5)
        share = share < 0.25 ? 0.0 : 1.0;
      else if (spread == Spread::kEdges)
        share = 2.0 * share - 1.0;
      q[static_cast<std::size_t>(k)] = ranges(k, 0) + share * (ranges(k, 1) - ranges(k, 0));
    }
    if (!admissible(kinematics, q.data(), cell)) continue;
    for (int k = 0; k < n; ++k)
      poses(static_cast<Eigen::Index>(found), k) = q[static_cast<std::size_t>(k)];
    ++found;
  }
  return poses;
}

}  // namespace armtrue
