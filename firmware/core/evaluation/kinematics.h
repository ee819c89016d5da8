// The arm's chain in fixed point (docs/model.md, "Chain"): nominal and real.
#ifndef ARMTRUE_FIRMWARE_CORE_EVALUATION_KINEMATICS_H_
#define ARMTRUE_FIRMWARE_CORE_EVALUATION_KINEMATICS_H_

#include <array>
#include <cstdint>

#include "firmware/core/table/limits.h"
#include "firmware/core/table/linear.h"
#include "firmware/core/table/table_view.h"

namespace armtrue {

using JointPositions = std::array<JointPosition, kMaxJoints>;
using JointMotions = std::array<JointMotion, kMaxJoints>;
using Coordinates = std::array<Coordinate, format::kCoordinates>;
using Frames = std::array<Frame, kMaxJoints>;

// A coordinate step of motor k (radian or metre, Q30) in units of its position (2^-32 turn or
// metre).
inline std::int32_t position_step(const TableView& table, std::size_t joint, Coordinate step) {
  return table.is_prismatic(joint) ? metres_of(step) : turns_of(step);
}

// Link variables C q + offset at motor-side positions q.
void link_positions(const TableView& table, const JointPositions& motor, JointPositions& link);

// Motions of all joints at link variables `link`.
void joint_motions(const TableView& table, const JointPositions& link, JointMotions& motions);

// Updates `motions` from link variables `from` to `to`, to second order in the turn t. The error of
// t³/6 is small enough for gravity (2e-8 of it at 5 mrad). Not for turns beyond 0.25 rad.
void turn_motions(const TableView& table, const JointPositions& from, const JointPositions& to,
                  JointMotions& motions);

// Nominal chain: returns the tool (its axes only for the full pose), and writes base_from_frame_k
// (after the joint) of every k to `frames`.
Frame nominal_tool(const TableView& table, const JointMotions& motions, Frames& frames);

// The real tool in the base frame: its point (Q27 m) and, if the table has the full pose, its x and
// y axes (Q30).
struct RealTool {
  Vector point;
  Vector x;
  Vector y;
};

// Real chain with the virtual joints of `coordinates`; motor-side deflections are in `motions`.
RealTool real_tool(const TableView& table, const JointMotions& motions,
                   const Coordinates& coordinates);

}  // namespace armtrue

#endif  // ARMTRUE_FIRMWARE_CORE_EVALUATION_KINEMATICS_H_
