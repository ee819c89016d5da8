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
      1.0;  ///< similarity scale of the measurements over the arm: 1000 where they are in mm
  double rms_m =
      0.0;  ///< root mean square distance left after alignment, gross errors down-weighted
  std::vector<double> residual_m;  ///< distance left, row by row
  /// Frames of further set-ups of the tracker in the frame of the first, by their number in column
  /// `station`: only of those that stand further from it than the error of the nominal arm. All
  /// other fields are of points that were moved into the frame of the first.
  std::map<int, Pose> first_from_set_up;
};

/// Solves x_i = base · (p_i + R_i t) for the base pose and the reflectors' t, with nominal
/// kinematics and no initial guess.
///
/// Written as Rᵀx_i − R_i t − b' = p_i it is linear in fifteen numbers (nine of R, unconstrained;
/// Andreff's and Kabsch's relaxations joined). The rotation is then projected onto SO(3), and the
/// result refined by iteratively reweighted Gauss–Newton, so that bumped reflectors do not count.
/// If the relaxation is degenerate for these poses, the 24 rotations of the cube are further
/// starts, and the best result is kept. Throws ModelError if there are fewer than 4 rows.
Alignment align(const State& state, const Measurements& measurements);

/// The frame of a row's set-up in `first_from_set_up`; null if it is not in there, as for the first
/// one, or if column `station` is missing.
const Pose* set_up_of(const std::map<int, Pose>& first_from_set_up, const State::Columns& columns,
                      std::size_t row);

}  // namespace armtrue
