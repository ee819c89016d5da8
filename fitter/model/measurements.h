// Measured positions (and orientations) of reflectors, row by row, and their uncertainty.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <vector>

#include "fitter/model/poses.h"
#include "fitter/model/rounding.h"
#include "fitter/model/state.h"

namespace armtrue {

/// Uncertainty of the measuring instrument, one standard deviation: a + b · distance, along and
/// across the line of sight.
struct Instrument {
  Eigen::Vector3d position = Eigen::Vector3d::Zero();  ///< in the measuring frame [m]
  double radial_a = 0.0, radial_b = 0.0;               ///< [m], [m/m]
  double angular_a = 0.0, angular_b = 0.0;             ///< [m], [m/m] across the line of sight

  /// From {position: [3] (optional), radial: {a, b}, angular: {a, b}}, as in model.yaml.
  static Instrument from_json(const nlohmann::json& content);
};

enum class SigmaSource { kColumn, kInstrument, kAssumed };

/// Measured poses with a whitening matrix per row.
struct Measurements {
  std::size_t rows = 0;
  Eigen::Matrix3Xd position;              ///< 3 × rows [m], measuring frame
  std::vector<Eigen::Matrix3d> rotation;  ///< rows, or empty where only positions were measured
  /// By row: the orientation is that of an earlier row of the same visit. Where several reflectors
  /// of a pose share one orientation, it was read once.
  std::vector<bool> rotation_is_copied;
  std::vector<int> target;  ///< 0-based reflector of each row
  int targets = 1;
  Poses poses;              ///< groups of rows of one pose, declared or not
  std::vector<int> repeat;  ///< same number = same pose measured again; empty where not recorded
  std::vector<Eigen::Matrix3d> whiten_position;  ///< W with WᵀW = inverse covariance [1/m]
  double sigma_rotation = 0.0;                   ///< [rad], where orientations were measured
  SigmaSource sigma_source = SigmaSource::kAssumed;
  double typical_sigma = 0.0;  ///< root mean square per axis [m]
  DecimalStep rounding;        ///< of all positions

  bool has_rotation() const { return !rotation.empty(); }
  /// Whitened units of a row's orientation per radian; 0 if the row has no orientation of its own.
  double per_rotation(std::size_t row) const {
    return rotation_is_copied[row] ? 0.0 : 1.0 / sigma_rotation;
  }
  /// By reflector: whether a row has its orientation.
  std::vector<bool> turns_of_targets() const;
  /// Rows of residual per measurement: 3 or 6.
  int residuals_per_row() const { return has_rotation() ? 6 : 3; }

  /// From a state's recorded columns (x, y, z needed; qw…qz, target, repeat, sigma if recorded).
  /// Throws ModelError.
  static Measurements from_state(const State& state, const std::optional<Instrument>& instrument,
                                 double assumed_sigma, double sigma_rotation);
};

}  // namespace armtrue
