// How far a step of the joints bends the tool's way off a straight line, and which share of it does
// not bend too far.
#ifndef ARMTRUE_FIRMWARE_CORE_EVALUATION_SECOND_ORDER_H_
#define ARMTRUE_FIRMWARE_CORE_EVALUATION_SECOND_ORDER_H_

#include <cstdint>

#include "firmware/core/evaluation/damped_solver.h"
#include "firmware/core/evaluation/kinematics.h"
#include "firmware/core/fixed/fixed.h"
#include "firmware/core/table/table_view.h"

namespace armtrue {

// The largest share, at most 1, of a step of the motors at which the nominal arm's tool leaves the
// straight line by an eighth of its way or less, to second order. `frames`, `tool`: where the step
// begins. (Rotations count times the rotation length where the table holds the full pose; of
// vectors, the sum of the components' sizes.)
//
// With the joints' axes z and the tool's velocities v by them, the way is Σ δi vi, and what the
// second order adds to it Σ_{i<j} δi δj zi × vj + ½ Σ δi² zi × vi, to the turn
// ½ Σ_{i<j} δi δj zi × zj.
Ratio straight_share(const TableView& table, const Frames& frames, const Vector& tool,
                     const JointStep& step);

}  // namespace armtrue

#endif  // ARMTRUE_FIRMWARE_CORE_EVALUATION_SECOND_ORDER_H_
