// How far the tool's path in a joint step bends off a straight line, and the share of the step that
// keeps this small.
#ifndef ARMTRUE_FIRMWARE_CORE_EVALUATION_SECOND_ORDER_H_
#define ARMTRUE_FIRMWARE_CORE_EVALUATION_SECOND_ORDER_H_

#include <cstdint>

#include "firmware/core/evaluation/damped_solver.h"
#include "firmware/core/evaluation/kinematics.h"
#include "firmware/core/fixed/fixed.h"
#include "firmware/core/table/table_view.h"

namespace armtrue {

// The largest share, at most 1, of a motor step with which the nominal arm's tool leaves the
// straight line by at most an eighth of its path length, to second order. `frames`, `tool`: at the
// start of the step. (Rotations are weighed by the rotation length if the table has the full pose;
// the size of a vector is the sum of its components' magnitudes.)
//
// With joint axes zi and tool velocities vi per unit of joint i, the path is Σ δi vi. The second
// order adds Σ_{i<j} δi δj zi × vj + ½ Σ δi² zi × vi to it, and ½ Σ_{i<j} δi δj zi × zj to the
// rotation.
Ratio straight_share(const TableView& table, const Frames& frames, const Vector& tool,
                     const JointStep& step);

}  // namespace armtrue

#endif  // ARMTRUE_FIRMWARE_CORE_EVALUATION_SECOND_ORDER_H_
