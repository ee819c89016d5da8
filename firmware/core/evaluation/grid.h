// Multilinear interpolation of int16 tables of one to kMaxGridAxes variables.
//
// Nodes that were not trained hold zero and are marked in the coverage bits, so that the value
// fades to neutral across the cells beside them. Beyond its first and last node an axis holds its
// value (if flagged) or fades to zero over the width of its outermost cell: continuous everywhere.
#ifndef ARMTRUE_FIRMWARE_CORE_EVALUATION_GRID_H_
#define ARMTRUE_FIRMWARE_CORE_EVALUATION_GRID_H_

#include <cstddef>
#include <cstdint>

namespace armtrue {

// Writes the outputs of the grid whose data begin at `data` to `output`, int16 value times 2^12.
// `slots` are the values that its axes refer to. Returns false if the point, or a corner of its
// cell, lies outside the coverage.
bool interpolate(const std::uint8_t* data, const std::int32_t* slots, std::int32_t* output);

}  // namespace armtrue

#endif  // ARMTRUE_FIRMWARE_CORE_EVALUATION_GRID_H_
