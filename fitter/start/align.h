// Base and tool from nothing: where the robot stands in the measuring frame and where the reflector
// sits on the flange.
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
  /// Frames of further set-ups of the tracker, by their number in column `station`, seen from the
  /// first set-up: of those that stand further from it than the nominal arm is wrong by. All other
  /// fields are of points that were moved into the first one's frame.
  std::map<int, Pose> first_from_set_up;
};

/// Solves x_i = base · (p_i + R_i t) for the base pose and the reflectors' t, with nominal
/// kinematics and no initial guess.
///
/// Written as Rᵀx_i − R_i t − b' = p_i it is linear in fifteen numbers (nine of R, unconstrained;
/// Andreff's and Kabsch's relaxations joined); the rotation is then projected onto SO(3) and all is
/// refined by iteratively reweighted Gauss–Newton, so that bumped reflectors do not count. Where
/// the poses leave the relaxation degenerate, a multi-start over the 24 rotations of the cube takes
/// part and the best is kept. Throws ModelError where there are fewer than 4 rows.
Alignment align(const State& state, const Measurements& measurements);

/// The frame of a row's set-up among `first_from_set_up`; none where it is the first one's, or
/// column `station` is not there.
const Pose* set_up_of(const std::map<int, Pose>& first_from_set_up, const State::Columns& columns,
                      std::size_t row);

}  // namespace armtrue
