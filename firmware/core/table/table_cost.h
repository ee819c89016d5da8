// Cost of a table in every control cycle, counted from its content before it is accepted.
//
// Lengths of loops in the joint path depend on the table alone, so the longest way through a cycle
// is a sum over its records. Weights are instructions of the STM32F405 image, each the largest
// measured for its kind (tests/firmware/test_cycle_cost.py measures them in QEMU and checks that
// every kind of record, alone and mixed, stays below this count).
#ifndef ARMTRUE_FIRMWARE_CORE_TABLE_TABLE_COST_H_
#define ARMTRUE_FIRMWARE_CORE_TABLE_TABLE_COST_H_

#include <cstdint>
#include <span>

namespace armtrue {

// Upper bound of the instructions of one Compensator::cycle() with this table. Precondition: the
// contents of `image` passed check_contents().
std::uint32_t cycle_cost(std::span<const std::uint8_t> image);

}  // namespace armtrue

#endif  // ARMTRUE_FIRMWARE_CORE_TABLE_TABLE_COST_H_
