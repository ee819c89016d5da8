// Counters that a client reads: they stop at their maximum, since one that wraps looks like few.
#ifndef ARMTRUE_FIRMWARE_CORE_FIXED_COUNTER_H_
#define ARMTRUE_FIRMWARE_CORE_FIXED_COUNTER_H_

#include <cstdint>

namespace armtrue {

constexpr void count(std::uint32_t& counter) {
  if (counter != UINT32_MAX) ++counter;
}

}  // namespace armtrue

#endif  // ARMTRUE_FIRMWARE_CORE_FIXED_COUNTER_H_
