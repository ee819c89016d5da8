// Groups rows by pose, and by visit of the arm to that pose.
#pragma once

#include <vector>

#include "fitter/model/state.h"

namespace armtrue {

/// Rows by posture (the joint angles), pose (a posture with one payload) and visit of the arm to a
/// pose, each numbered from 0 in order of first appearance. Folds are sets of postures; repeats,
/// noise and degrees of freedom are based on poses and visits.
struct Poses {
  std::vector<int> posture_of_row, pose_of_row, visit_of_row;
  int poses = 0, visits = 0;

  /// Rows of each posture, and of each pose.
  std::vector<std::vector<std::size_t>> rows_by_posture() const;
  std::vector<std::vector<std::size_t>> rows_by_pose() const;
  bool any_repeated() const { return poses < static_cast<int>(pose_of_row.size()); }
};

/// Rows belong to one posture if `repeat` says so, or if all commanded joints agree within 1e-5 rad
/// (1e-6 m): a drive of 2^20 increments a turn resolves 6e-6 rad. A posture with different payloads
/// is as many poses: these scatter by what the load does. Readings of one pose belong to
/// one visit if nothing else was measured between them (by time, else by row); a declared repeat of
/// the same reflector is a new visit. If reflectors stand in separate parts of a file without time,
/// the n-th readings of a pose's reflectors are one visit. `target`: reflector of each row;
/// `repeat`: declared repeats, or empty.
Poses find_poses(const State& state, const std::vector<int>& target,
                 const std::vector<int>& repeat);

}  // namespace armtrue
