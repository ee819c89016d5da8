// Which rows are one pose, and which of those were read in one visit of the arm.
#pragma once

#include <vector>

#include "fitter/model/state.h"

namespace armtrue {

/// Rows by pose and by visit, numbered from 0 in order of first appearance. Folds, repeats, noise
/// and degrees of freedom all go by this.
struct Poses {
  std::vector<int> pose_of_row, visit_of_row;
  int poses = 0, visits = 0;

  /// Rows of each pose.
  std::vector<std::vector<std::size_t>> rows_by_pose() const;
  bool any_repeated() const { return poses < static_cast<int>(pose_of_row.size()); }
};

/// Rows are one pose where `repeat` says so, or where all commanded joints agree within 1e-5 rad
/// (1e-6 m): a drive of 2^20 increments a turn resolves 6e-6 rad. Readings of one pose belong to
/// one visit where nothing else was measured between them (by time, else by row); a reflector
/// declared a repeat of itself was reached anew. Where reflectors stand apart in the file without
/// time, the n-th readings of a pose's reflectors are one visit. `target`: reflector of each row;
/// `repeat`: declared repeats, or empty.
Poses find_poses(const State& state, const std::vector<int>& target,
                 const std::vector<int>& repeat);

}  // namespace armtrue
