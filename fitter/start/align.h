// Base and tool without an initial guess: the pose of the robot in the measuring frame, and of the
// reflector on the flange.
#pragma once

#include <map>
#include <vector>

#include "fitter/model/measurements.h"
#include "fitter/model/robot.h"

namespace armtrue {

struct Alignment {
  Pose measuring_from_base = Pose::Identity();
  std::vector<Pose>
      flange_from_tool;  ///< one per target; rotation identity where only positions were measured
  double scale =
      1.0;  ///< similarity scale of the measurements relative to the arm: 1000 if they are in mm
  double rms_m =
      0.0;  ///< root mean square distance left after alignment, gross errors down-weighted
  std::vector<double> residual_m;  ///< distance left, row by row
  /// Pose of each further set-up of the tracker in the frame of the first, by its number in column
  /// `station`. Only set-ups that stand further from the first than the error of the nominal arm
  /// are included. All other fields refer to points that were moved into the frame of the first.
  std::map<int, Pose> first_from_set_up;
};

/// Solves x_i = base · (p_i + R_i t) for the base pose and the reflectors' t, with nominal
/// kinematics and no initial guess.
///
/// Written as Rᵀx_i − R_i t − b' = p_i it is linear in fifteen numbers (nine of R, unconstrained;
/// Andreff's and Kabsch's relaxations combined). The rotation is then projected onto SO(3), and the
/// result refined by iteratively reweighted Gauss–Newton, so that gross errors have little weight.
/// If the relaxation is degenerate for these poses, the 24 rotations of the cube are further
/// starts, and the best result is kept. Throws ModelError if there are fewer than 4 rows.
Alignment align(const State& state, const Measurements& measurements);

/// The entry of a row's set-up in `first_from_set_up`; null if it has none, as the first set-up, or
/// if column `station` is missing.
const Pose* set_up_of(const std::map<int, Pose>& first_from_set_up, const State::Columns& columns,
                      std::size_t row);

}  // namespace armtrue
