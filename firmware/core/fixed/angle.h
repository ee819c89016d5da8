// Sine and cosine of binary angles.
#ifndef ARMTRUE_FIRMWARE_CORE_FIXED_ANGLE_H_
#define ARMTRUE_FIRMWARE_CORE_FIXED_ANGLE_H_

#include <cstdint>

#include "firmware/core/fixed/fixed.h"

namespace armtrue {

// sin(π/2 · x) / x as a polynomial in x² on 0 ≤ x² ≤ 1: weighted minimax (Remez), error of the sine
// 1.4e-11 before rounding. Coefficient i has 30 + i fraction bits, as Horner's scheme with
// high-half products (Q31 · Q(31+i) → Q(30+i)) needs. These products round down; each coefficient
// includes the half unit that makes this a rounding to nearest.
namespace sine_polynomial {
inline constexpr std::int32_t k0 = 1686629713;   //  1.5707963267
inline constexpr std::int32_t k1 = -1387197326;  // -0.6459640928
inline constexpr std::int32_t k2 = 342277057;    //  0.0796925873
inline constexpr std::int32_t k3 = -40214812;    // -0.0046816204
inline constexpr std::int32_t k4 = 2752512;      //  0.0001602172
inline constexpr std::int32_t k5 = -117449;      // -0.0000034182
}  // namespace sine_polynomial

// Sine of a binary angle; |error| < 2.0e-9 (bounds/sine.g proves the evaluation, `./dev bench` goes
// through all 2^32 angles). Executes the same instructions for every angle.
constexpr Ratio sine(BinaryAngle angle) {
  constexpr std::uint32_t kHalfTurn = 0x80000000U;
  // Fold the second and third quadrant onto the first and fourth: sin(π - a) = sin(a).
  const bool is_far = static_cast<std::int32_t>(angle.raw ^ (angle.raw << 1U)) < 0;
  const auto x = static_cast<std::int32_t>(is_far ? kHalfTurn - angle.raw : angle.raw);
  // x is in quarter turns, Q30, -1 … 1; its square in Q31, just short of 1.
  const std::int64_t wide = product(x, x) >> 29;
  const auto square = static_cast<std::int32_t>(wide - (wide >> 31));
  std::int32_t sum = sine_polynomial::k4 + high(sine_polynomial::k5, square);
  sum = sine_polynomial::k3 + high(sum, square);
  sum = sine_polynomial::k2 + high(sum, square);
  sum = sine_polynomial::k1 + high(sum, square);
  sum = sine_polynomial::k0 + high(sum, square);
  return {multiply<Ratio::fraction>(sum, x)};
}

constexpr Ratio cosine(BinaryAngle angle) { return sine({angle.raw + kQuarterTurn.raw}); }

}  // namespace armtrue

#endif  // ARMTRUE_FIRMWARE_CORE_FIXED_ANGLE_H_
