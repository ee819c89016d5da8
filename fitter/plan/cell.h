// Limits of a measuring campaign in its cell, and random poses within them.
#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <vector>

#include "fitter/model/kinematics.h"

namespace armtrue {

/// Limits of a campaign. Points in the robot's base frame [m], angles [rad]; an empty member sets
/// no limit.
struct Cell {
  std::optional<Eigen::AlignedBox3d> box;  ///< the tool point stays inside
  std::optional<double> floor;             ///< no joint's origin and no tool point is below this z
  std::optional<Eigen::Vector3d>
      tracker;              ///< the line from this point to the tool point must be clear of the arm
  double clearance = 0.12;  ///< [m] least distance of that line from the arm's lines
  std::optional<double> acceptance;  ///< largest angle between that line and `opening`
  Eigen::Vector3d opening =
      Eigen::Vector3d::UnitZ();  ///< viewing direction of the reflector, in the tool frame

  /// From {box: [[lo, hi] × 3], floor, tracker: [3], clearance, acceptance, opening: [3]}.
  /// Throws ModelError naming the invalid entry.
  static Cell from_json(const nlohmann::json& content);
};

/// Lowest and highest value of each joint (n × 2): the limits of robot.yaml, or a full turn without
/// limits, less a fiftieth at each end to stay off the limits. `recorded` (rows × n, row-major, may
/// be empty) bounds joints without limits instead. Throws ModelError for a prismatic joint with
/// neither.
Eigen::MatrixX2d joint_ranges(const Robot& robot, const std::vector<double>& recorded);

/// Distribution of random poses over the joints' ranges.
enum class Spread {
  kUniform,  ///< evenly
  kEdges  ///< each joint at an end of its range half of the time: optimal designs tend to be there
};

/// True if the pose q (n) is within the cell, the passive joints' limits and the linkage's stops.
/// `kinematics` has the base at the origin and the tool on the flange.
bool admissible(Kinematics& kinematics, const double* q, const Cell& cell);

/// `count` random admissible poses (count × n), the same for the same seed.
/// Throws ModelError if hardly any pose is admissible.
Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor> reachable_poses(
    const Robot& robot, const Pose& flange_from_tool, const Cell& cell,
    const Eigen::MatrixX2d& ranges, Spread spread, std::size_t count, std::uint64_t seed);

}  // namespace armtrue
