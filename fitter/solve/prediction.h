// Predicted positions of a fitted arm at new poses, and their covariance.
#pragma once

#include <Eigen/Core>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "fitter/solve/fit.h"

namespace armtrue {

/// State and kinematics of a saved fit, for prediction at new poses without the measurements.
struct FittedModel {
  Robot robot;
  Model model;
  std::vector<std::string> targets;
  std::vector<Pose> flange_from_tool;
  Pose measuring_from_base = Pose::Identity();
  std::map<int, Pose> first_from_set_up;  ///< Alignment::first_from_set_up
  double time_origin = 0.0;               ///< [s] on the clock of the fitted measurements
  bool loads_follow = true;               ///< State::let_loads_follow

  /// From fit.json's content. Throws ModelError.
  static FittedModel from_json(const nlohmann::json& document);
  /// Predicted poses in the measuring frame of each row's set-up. `target`: by row, an index into
  /// `targets`.
  std::vector<Pose> predict(const State::Columns& columns, const std::vector<int>& target) const;
};

/// Writes poses as the measured columns x, y, z and, where asked for, qw to qz.
void put_poses(const std::vector<Pose>& poses, bool orientation, State::Columns& columns);

/// A fit at its solution, with all parameters free. The fit holds at nominal what its poses do not
/// determine, but other poses may depend on such parameters: their standard deviation is then that
/// of their prior or, without one, 1 m or 1 rad.
struct FreedFit {
  explicit FreedFit(const Fit& fit);
  FreedFit(const FreedFit&) = delete;
  FreedFit& operator=(const FreedFit&) = delete;

  State state;
  Model model;
  Design design;  ///< of the fit's rows and weights
};

/// Covariance of each predicted position [m²], without the instrument's noise: the covariance of
/// all parameters (also those held at nominal; with priors, smoothness and robust weights),
/// propagated by the derivatives of what a prediction contains. Parameters that depend on the
/// history before a pose (warmth of a gear) are not in a prediction: their effect counts as random,
/// with its mean square over the measurements. Throws ModelError.
std::vector<Eigen::Matrix3d> predicted_position_covariance(const Fit& fit,
                                                           const State::Columns& columns,
                                                           const std::vector<int>& target);

}  // namespace armtrue
