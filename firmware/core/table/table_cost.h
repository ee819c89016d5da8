// What a table costs in every control cycle, counted from its content before it is let in.
//
// The joint path has no loop whose length depends on anything but the table, so the longest way
// through a cycle is a sum over its records. Weights are instructions of the STM32F405 image, each
// the most that was measured of its kind (tests/firmware/test_cycle_cost.py measures them in QEMU
// and holds every kind of record, alone and mixed, below this count).
#ifndef ARMTRUE_FIRMWARE_CORE_TABLE_TABLE_COST_H_
#define ARMTRUE_FIRMWARE_CORE_TABLE_TABLE_COST_H_

#include <cstdint>
#include <span>

namespace armtrue {

// Instructions of one Compensator::cycle() with this table at most. Precondition: the contents of
// `image` passed check_contents().
std::uint32_t cycle_cost(std::span<const std::uint8_t> image);

}  // namespace armtrue

#endif  // ARMTRUE_FIRMWARE_CORE_TABLE_TABLE_COST_H_
