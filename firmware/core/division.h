// Division of 64-bit numbers by small ones, in steps that a 32-bit divider makes: the compiler's
// own routine for any two 64-bit numbers takes 900 bytes of flash.
#ifndef ARMTRUE_FIRMWARE_CORE_DIVISION_H_
#define ARMTRUE_FIRMWARE_CORE_DIVISION_H_

#include <cstdint>

namespace armtrue {

// x / divisor, rounded down; long division in digits of 16 bits. divisor ≥ 1.
constexpr std::uint64_t quotient(std::uint64_t x, std::uint16_t divisor) {
  std::uint64_t result = 0;
  std::uint32_t rest = 0;
  for (int shift = 48; shift >= 0; shift -= 16) {
    const std::uint32_t digits = (rest << 16U) | (static_cast<std::uint32_t>(x >> shift) & 0xFFFFU);
    result = (result << 16U) | (digits / divisor);
    rest = digits % divisor;
  }
  return result;
}

constexpr std::uint64_t milliseconds_of(std::uint64_t microseconds) {
  return quotient(microseconds, 1000);
}

// amount · parts / 10^6, rounded down, for a product below 2^63: what a rate a second makes in some
// microseconds.
constexpr std::uint64_t millionths(std::uint32_t amount, std::uint32_t parts) {
  return quotient(static_cast<std::uint64_t>(amount) * parts, 15625) >> 6U;
}

}  // namespace armtrue

#endif  // ARMTRUE_FIRMWARE_CORE_DIVISION_H_
