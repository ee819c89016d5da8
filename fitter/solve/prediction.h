// Where a fitted arm will be at poses that nobody measured, and how well that is known.
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
  std::map<int, Pose> first_from_set_up;  ///< Alignment's
  double time_origin = 0.0;               ///< [s] on the clock of the fitted measurements
  bool loads_follow = true;               ///< State::let_loads_follow

  /// From fit.json's content. Throws ModelError.
  static FittedModel from_json(const nlohmann::json& document);
  /// Predicted poses in the measuring frame, which is that of the row's set-up. `target` numbers
  /// index `targets`.
  std::vector<Pose> predict(const State::Columns& columns, const std::vector<int>& target) const;
};

/// Writes poses as the measured columns x, y, z and, where asked for, qw to qz.
void put_poses(const std::vector<Pose>& poses, bool orientation, State::Columns& columns);

/// A fit at its solution, with all parameters free. The fit itself holds at nominal what its poses
/// could not tell; other poses may show it. How large it may be, its prior says, and where it has
/// none, a metre or a radian.
struct FreedFit {
  explicit FreedFit(const Fit& fit);
  FreedFit(const FreedFit&) = delete;
  FreedFit& operator=(const FreedFit&) = delete;

  State state;
  Model model;
  Design design;  ///< of the fit's rows and weights
};

/// Covariance of each predicted position [m²], without the instrument's noise: the covariance of
/// all parameters, those held at nominal too (priors, smoothness and robust weights in it), carried
/// over by the derivatives of what a prediction contains. An unknown that no prediction contains
/// (of a gear's own warmth) so makes base and tool less sure, and nothing else. Throws ModelError.
std::vector<Eigen::Matrix3d> predicted_position_covariance(const Fit& fit,
                                                           const State::Columns& columns,
                                                           const std::vector<int>& target);

}  // namespace armtrue
