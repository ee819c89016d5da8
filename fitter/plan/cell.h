// Where in its cell an arm may be sent, and random poses that keep to it.
#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <vector>

#include "fitter/model/kinematics.h"

namespace armtrue {

/// Limits of a campaign. Points in the robot's base frame [m], angles [rad]; what is not given does
/// not limit.
struct Cell {
  std::optional<Eigen::AlignedBox3d> box;  ///< the tool point stays inside
  std::optional<double> floor;  ///< no joint's origin and no tool point comes below this z
  std::optional<Eigen::Vector3d>
      tracker;                       ///< the line from here to the tool point is free of the arm
  double clearance = 0.12;           ///< [m] between that line and the arm's lines
  std::optional<double> acceptance;  ///< largest angle between that line and `opening`
  Eigen::Vector3d opening =
      Eigen::Vector3d::UnitZ();  ///< where the reflector looks, in the tool frame

  /// From {box: [[lo, hi] × 3], floor, tracker: [3], clearance, acceptance, opening: [3]}.
  /// Throws ModelError naming what is out of order.
  static Cell from_json(const nlohmann::json& content);
};

/// Lowest and highest value of each joint (n × 2): the limits of robot.yaml, a full turn where
/// there are none, less a fiftieth at each end, as nobody likes to stand on a limit. `recorded`
/// (rows × n, row-major, may be empty) bounds joints without limits instead. Throws ModelError for
/// a prismatic joint that neither bounds.
Eigen::MatrixX2d joint_ranges(const Robot& robot, const std::vector<double>& recorded);

/// How random poses are spread over the joints' ranges.
enum class Spread {
  kUniform,  ///< evenly
  kEdges  ///< each joint at an end of its range every other time: where optimal designs like to be
};

/// True where the pose q (n) keeps to the cell and to the linkage's stops. `kinematics` has the
/// base at the origin and the tool on the flange.
bool admissible(Kinematics& kinematics, const double* q, const Cell& cell);

/// `count` random admissible poses (count × n), the same for the same seed.
/// Throws ModelError where hardly any pose is admissible.
Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor> reachable_poses(
    const Robot& robot, const Pose& flange_from_tool, const Cell& cell,
    const Eigen::MatrixX2d& ranges, Spread spread, std::size_t count, std::uint64_t seed);

}  // namespace armtrue
