#include "fitter/model/poses.h"

#include <algorithm>
#include <boost/pending/disjoint_sets.hpp>
#include <cmath>
#include <map>
#include <numeric>

namespace armtrue {
namespace {

constexpr double kSameAngle = 1e-5, kSameSlide = 1e-6;  // [rad], [m]
constexpr double kSamePayload = 0.02;                   // share of the largest payload

using DisjointSets = boost::disjoint_sets_with_storage<>;

void join_equal_joints(const State& state, DisjointSets& sets) {
  const auto n = static_cast<std::size_t>(state.robot().joint_count());
  const std::vector<double>& q = state.joints();
  std::vector<double> tolerance;
  for (const Joint& joint : state.robot().joints)
    tolerance.push_back(joint.prismatic ? kSameSlide : kSameAngle);
  std::vector<std::size_t> order(state.rows());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::ranges::stable_sort(order, {}, [&](std::size_t row) { return q[row * n]; });
  for (std::size_t at = 0; at < order.size(); ++at) {
    for (std::size_t before = at; before-- > 0;) {
      const std::size_t a = order[at], b = order[before];
      if (q[a * n] - q[b * n] > tolerance[0]) break;
      std::size_t k = 0;
      while (k < n && std::abs(q[a * n + k] - q[b * n + k]) <= tolerance[k]) ++k;
      if (k == n) sets.union_set(a, b);
    }
  }
}

void number_visits(const State& state, const std::vector<int>& target, bool declared,
                   Poses& poses) {
  const std::vector<std::size_t> order = state.measured_order();
  const bool timed = state.recorded("time");
  struct Pose {
    std::map<int, int> readings;  // number of readings by reflector
    int visit = -1, serial = 0;
    std::size_t last = 0;
    std::map<int, int> visit_of_serial;
  };
  std::map<int, Pose> seen;
  poses.visit_of_row.assign(state.rows(), 0);
  for (std::size_t at = 0; at < order.size(); ++at) {
    const std::size_t row = order[at];
    Pose& pose = seen[poses.pose_of_row[row]];
    const bool adjacent = pose.visit >= 0 && pose.last + 1 == at;
    const bool read_before = pose.readings.contains(target[row]);
    const bool declared_anew = read_before && declared;
    int& readings = pose.readings[target[row]];
    if (pose.visit < 0 || declared_anew || !adjacent) {
      // Without time, another reflector's readings of this visit may stand elsewhere in the file.
      const bool same_serial = !timed && pose.visit_of_serial.contains(readings);
      pose.visit = same_serial ? pose.visit_of_serial[readings] : poses.visits++;
      pose.visit_of_serial[readings] = pose.visit;
      ++readings;
    } else if (!read_before) {
      ++readings;
    }
    pose.last = at;
    poses.visit_of_row[row] = pose.visit;
  }
}

// Numbers each posture's rows by their payload.
void number_poses(const State& state, Poses& poses) {
  std::vector<double> payload(state.rows(), 0.0);
  if (state.recorded("payload")) payload = state.column("payload");
  double largest = 0.0;
  for (const double mass : payload) largest = std::max(largest, std::abs(mass));
  std::map<int, std::vector<std::pair<double, int>>> of_posture;  // payload and number of a pose
  for (std::size_t i = 0; i < state.rows(); ++i) {
    auto& known = of_posture[poses.posture_of_row[i]];
    auto same = std::ranges::find_if(known, [&](const auto& pose) {
      return std::abs(pose.first - payload[i]) <= kSamePayload * largest;
    });
    if (same == known.end()) same = known.insert(known.end(), {payload[i], poses.poses++});
    poses.pose_of_row.push_back(same->second);
  }
}

std::vector<std::vector<std::size_t>> rows_by(const std::vector<int>& group_of_row) {
  std::vector<std::vector<std::size_t>> rows;
  for (std::size_t i = 0; i < group_of_row.size(); ++i) {
    const auto group = static_cast<std::size_t>(group_of_row[i]);
    if (group >= rows.size()) rows.resize(group + 1);
    rows[group].push_back(i);
  }
  return rows;
}

}  // namespace

std::vector<std::vector<std::size_t>> Poses::rows_by_posture() const {
  return rows_by(posture_of_row);
}

std::vector<std::vector<std::size_t>> Poses::rows_by_pose() const { return rows_by(pose_of_row); }

Poses find_poses(const State& state, const std::vector<int>& target,
                 const std::vector<int>& repeat) {
  DisjointSets sets(state.rows());
  join_equal_joints(state, sets);
  std::map<int, std::size_t> declared;
  for (std::size_t i = 0; i < repeat.size(); ++i) {
    const auto [first, fresh] = declared.try_emplace(repeat[i], i);
    if (!fresh) sets.union_set(i, first->second);
  }
  Poses poses;
  std::map<std::size_t, int> number;
  for (std::size_t i = 0; i < state.rows(); ++i) {
    const auto next = static_cast<int>(number.size());
    poses.posture_of_row.push_back(number.try_emplace(sets.find_set(i), next).first->second);
  }
  number_poses(state, poses);
  number_visits(state, target, !repeat.empty(), poses);
  return poses;
}

}  // namespace armtrue
