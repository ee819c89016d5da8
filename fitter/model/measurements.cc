#include "fitter/model/measurements.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <nlohmann/json.hpp>

namespace armtrue {
namespace {

std::vector<int> integers(const std::vector<double>& values) {
  std::vector<int> result;
  for (const double v : values) result.push_back(static_cast<int>(std::lround(v)));
  return result;
}

// Covariance σ_r² along the line of sight, σ_a² across it; its inverse square root has the same
// axes.
Eigen::Matrix3d whiten_instrument(const Instrument& instrument, const Eigen::Vector3d& point,
                                  double& variance) {
  const Eigen::Vector3d sight = point - instrument.position;
  const double distance = sight.norm();
  const double radial = instrument.radial_a + instrument.radial_b * distance;
  const double angular = instrument.angular_a + instrument.angular_b * distance;
  variance = (radial * radial + 2.0 * angular * angular) / 3.0;
  const Eigen::Vector3d u =
      distance > 0.0 ? Eigen::Vector3d(sight / distance) : Eigen::Vector3d::UnitX();
  return Eigen::Matrix3d::Identity() / angular + (1.0 / radial - 1.0 / angular) * u * u.transpose();
}

std::vector<bool> copied_rotations(const std::vector<Eigen::Matrix3d>& rotation,
                                   const std::vector<int>& visit_of_row) {
  std::map<int, std::vector<std::size_t>> read;  // by visit: rows with an orientation of their own
  std::vector<bool> copied(rotation.size());
  for (std::size_t i = 0; i < rotation.size(); ++i) {
    std::vector<std::size_t>& earlier = read[visit_of_row[i]];
    copied[i] =
        std::ranges::any_of(earlier, [&](std::size_t e) { return rotation[e] == rotation[i]; });
    if (!copied[i]) earlier.push_back(i);
  }
  return copied;
}

}  // namespace

Instrument Instrument::from_json(const nlohmann::json& content) {
  Instrument instrument;
  if (content.contains("position")) {
    const auto p = content["position"].get<std::vector<double>>();
    instrument.position = {p.at(0), p.at(1), p.at(2)};
  }
  const auto law = [&](const char* part, double& a, double& b) {
    content.at(part).at("a").get_to(a);
    b = content.at(part).value("b", 0.0);
  };
  law("radial", instrument.radial_a, instrument.radial_b);
  law("angular", instrument.angular_a, instrument.angular_b);
  return instrument;
}

Measurements Measurements::from_state(const State& state,
                                      const std::optional<Instrument>& instrument,
                                      double assumed_sigma, double sigma_rotation) {
  Measurements m;
  m.rows = state.rows();
  m.position.resize(3, static_cast<Eigen::Index>(m.rows));
  const char* axes[] = {"x", "y", "z"};
  for (int c = 0; c < 3; ++c) {
    if (!state.recorded(axes[c])) {
      throw ModelError(std::string("measurements: column ") + axes[c] +
                       " is missing, expected x, y and z");
    }
    const std::vector<double>& column = state.column(axes[c]);
    for (std::size_t i = 0; i < m.rows; ++i)
      m.position(c, static_cast<Eigen::Index>(i)) = column[i];
  }
  if (state.recorded("qw")) {
    const auto &qw = state.column("qw"), &qx = state.column("qx"), &qy = state.column("qy"),
               &qz = state.column("qz");
    m.rotation.reserve(m.rows);
    for (std::size_t i = 0; i < m.rows; ++i) {
      m.rotation.push_back(
          Eigen::Quaterniond(qw[i], qx[i], qy[i], qz[i]).normalized().toRotationMatrix());
    }
    m.sigma_rotation = sigma_rotation;
  }
  m.rounding = step_of_lengths({m.position.data(), static_cast<std::size_t>(m.position.size())});
  m.target.assign(m.rows, 0);
  if (state.recorded("target")) {
    m.target = integers(state.column("target"));
    m.targets = 1 + *std::max_element(m.target.begin(), m.target.end());
  }
  if (state.recorded("repeat")) m.repeat = integers(state.column("repeat"));
  m.poses = find_poses(state, m.target, m.repeat);
  m.rotation_is_copied = copied_rotations(m.rotation, m.poses.visit_of_row);
  m.whiten_position.reserve(m.rows);
  double sum = 0.0;
  const std::vector<double>* sigma = state.recorded("sigma") ? &state.column("sigma") : nullptr;
  m.sigma_source = sigma ? SigmaSource::kColumn
                         : (instrument ? SigmaSource::kInstrument : SigmaSource::kAssumed);
  for (std::size_t i = 0; i < m.rows; ++i) {
    double variance = assumed_sigma * assumed_sigma;
    if (sigma) variance = (*sigma)[i] * (*sigma)[i];
    if (!sigma && instrument) {
      m.whiten_position.push_back(
          whiten_instrument(*instrument, m.position.col(static_cast<Eigen::Index>(i)), variance));
    } else {
      m.whiten_position.push_back(Eigen::Matrix3d::Identity() / std::sqrt(variance));
    }
    sum += variance;
  }
  m.typical_sigma = std::sqrt(sum / static_cast<double>(std::max<std::size_t>(m.rows, 1)));
  return m;
}

std::vector<bool> Measurements::turns_of_targets() const {
  std::vector<bool> turns(static_cast<std::size_t>(targets));
  for (std::size_t i = 0; i < rotation.size(); ++i) {
    if (!rotation_is_copied[i]) turns[static_cast<std::size_t>(target[i])] = true;
  }
  return turns;
}

}  // namespace armtrue
