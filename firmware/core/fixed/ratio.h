// Comparing products of integers and powers of two without leaving 64 bits.
#ifndef ARMTRUE_FIRMWARE_CORE_FIXED_RATIO_H_
#define ARMTRUE_FIRMWARE_CORE_FIXED_RATIO_H_

#include <bit>
#include <cstdint>

namespace armtrue {

// |x|, the smallest number included.
constexpr std::uint64_t magnitude(std::int64_t x) {
  return x < 0 ? 0U - static_cast<std::uint64_t>(x) : static_cast<std::uint64_t>(x);
}

// mantissa · 2^exponent, not negative.
struct Scaled {
  std::uint64_t mantissa;
  int exponent;
};

// The same number with the highest bit of its mantissa set; 0 stays 0.
constexpr Scaled normalised(Scaled x) {
  if (x.mantissa == 0U) return x;
  const int shift = std::countl_zero(x.mantissa);
  return {x.mantissa << shift, x.exponent - shift};
}

// True if a and b differ by at most 2^-26 of the larger, which is slightly more than the rounding
// of two 30-bit mantissas can cause. False if either is 0.
constexpr bool nearly_equal(Scaled a, Scaled b) {
  constexpr int kTolerance = 26;
  const Scaled one = normalised(a);
  const Scaled other = normalised(b);
  if (one.mantissa == 0U || other.mantissa == 0U) return false;
  const bool one_is_larger = one.exponent != other.exponent ? one.exponent > other.exponent
                                                            : one.mantissa > other.mantissa;
  const Scaled& large = one_is_larger ? one : other;
  const Scaled& small = one_is_larger ? other : one;
  const int apart = large.exponent - small.exponent;  // 1 if a power of two lies between them
  return apart <= 1 && large.mantissa - (small.mantissa >> apart) <= large.mantissa >> kTolerance;
}

}  // namespace armtrue

#endif  // ARMTRUE_FIRMWARE_CORE_FIXED_RATIO_H_
