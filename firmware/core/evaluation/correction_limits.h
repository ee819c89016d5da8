// The largest correction of each joint, and the scaling of a correction that exceeds one of them.
//
// The joints act together: near a singularity two of them turn far, against each other, to move the
// tool a little. If only one of them were clamped, the other's motion would remain, and the tool
// could end up further off than without any correction. So every joint gets the same share of its
// correction. To first order the tool's error is then (1 - share) of the uncorrected error.
#ifndef ARMTRUE_FIRMWARE_CORE_EVALUATION_CORRECTION_LIMITS_H_
#define ARMTRUE_FIRMWARE_CORE_EVALUATION_CORRECTION_LIMITS_H_

#include <array>
#include <cstddef>
#include <cstdint>

#include "firmware/core/table/limits.h"
#include "firmware/core/table/table_view.h"

namespace armtrue {

// One value per joint, 2^-32 turn or metre.
using JointAmounts = std::array<std::int32_t, kMaxJoints>;

// The table's limit for the joint, capped by limits.h. Not negative in an accepted table.
std::int32_t largest_correction(const TableView& table, std::size_t joint);

// If a joint of `correction` exceeds its limit in `largest`, scales all joints by one factor, so
// that the joint with the largest ratio of correction to limit ends exactly at its limit. Results
// are rounded towards zero. A correction within all limits is not changed. Returns a bit for each
// joint that was beyond its own limit.
std::uint32_t scale_into_limits(const JointAmounts& largest, std::size_t joints,
                                JointAmounts& correction);

}  // namespace armtrue

#endif  // ARMTRUE_FIRMWARE_CORE_EVALUATION_CORRECTION_LIMITS_H_
