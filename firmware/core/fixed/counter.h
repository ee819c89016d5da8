// Counters that a client reads. They stop at their maximum, because a wrapped counter would read as
// a small number.
#ifndef ARMTRUE_FIRMWARE_CORE_FIXED_COUNTER_H_
#define ARMTRUE_FIRMWARE_CORE_FIXED_COUNTER_H_

#include <cstdint>

namespace armtrue {

constexpr void count(std::uint32_t& counter) {
  if (counter != UINT32_MAX) ++counter;
}

}  // namespace armtrue

#endif  // ARMTRUE_FIRMWARE_CORE_FIXED_COUNTER_H_
