// The largest correction of each joint, and how a correction that exceeds one of them is made
// smaller.
//
// The joints of one correction work together: near a singularity two of them turn far, against each
// other, to move the tool a little. To cut one alone leaves the tool with what the other does, and
// it may end up further off than without any correction. So every joint gets the same share of its
// correction. To first order the tool's error is then (1 - share) of what it was uncorrected.
#ifndef ARMTRUE_FIRMWARE_CORE_EVALUATION_CORRECTION_LIMITS_H_
#define ARMTRUE_FIRMWARE_CORE_EVALUATION_CORRECTION_LIMITS_H_

#include <array>
#include <cstddef>
#include <cstdint>

#include "firmware/core/table/limits.h"
#include "firmware/core/table/table_view.h"

namespace armtrue {

// By joint, 2^-32 turn or metre.
using JointAmounts = std::array<std::int32_t, kMaxJoints>;

// What the table permits the joint, capped by limits.h. Not negative in an accepted table.
std::int32_t largest_correction(const TableView& table, std::size_t joint);

// Makes `correction` smaller where a joint's exceeds its largest: all joints are multiplied by one
// factor, with which the joint that is furthest beyond its limit ends exactly at it. Each result is
// rounded towards zero. A correction within all limits stays as it is. Returns a bit for each joint
// that was beyond its own limit.
std::uint32_t scale_into_limits(const JointAmounts& largest, std::size_t joints,
                                JointAmounts& correction);

}  // namespace armtrue

#endif  // ARMTRUE_FIRMWARE_CORE_EVALUATION_CORRECTION_LIMITS_H_
