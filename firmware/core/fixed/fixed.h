// Fixed-point numbers: one type per format, with explicit rounding and saturation.
//
// A value is raw / 2^fraction in the unit of its tag. Types with different tags or fractions do not
// mix: every conversion is a named function here. Products are formed in 64 bits and rounded to
// nearest (ties up), never truncated, because a bias of half an LSB in every step of a chain adds
// up.
#ifndef ARMTRUE_FIRMWARE_CORE_FIXED_FIXED_H_
#define ARMTRUE_FIRMWARE_CORE_FIXED_FIXED_H_

#include <bit>
#include <cstdint>
#include <limits>
#include <type_traits>

namespace armtrue {

template <int kFraction, typename Tag>
struct Fixed {
  static constexpr int fraction = kFraction;
  std::int32_t raw;

  friend constexpr bool operator==(Fixed, Fixed) = default;
};

struct RatioTag;
struct LengthTag;
struct CoordinateTag;

// Sine, cosine, element of a rotation matrix: -2 … 2.
using Ratio = Fixed<30, RatioTag>;
// Position of a frame, metre: ±16 m in steps of 7.5 nm.
using Length = Fixed<27, LengthTag>;
// Virtual-joint or motor-side coordinate, radian or metre: ±2 in steps of 0.93 nrad or nm.
using Coordinate = Fixed<30, CoordinateTag>;

inline constexpr Ratio kRatioOne{std::int32_t{1} << Ratio::fraction};

// An angle as a fraction of a turn: 2^32 is one turn, so that it wraps by itself.
struct BinaryAngle {
  std::uint32_t raw;

  friend constexpr bool operator==(BinaryAngle, BinaryAngle) = default;
};

inline constexpr BinaryAngle kQuarterTurn{std::uint32_t{1} << 30};

// A joint variable that does not wrap: turns (revolute) or metres (prismatic), times 2^32.
struct JointPosition {
  std::int64_t raw;

  friend constexpr bool operator==(JointPosition, JointPosition) = default;
};

// x / 2^bits, rounded to nearest. bits in 1 … 62.
constexpr std::int64_t round_shift(std::int64_t x, int bits) {
  return (x + (std::int64_t{1} << (bits - 1))) >> bits;
}

constexpr std::int32_t saturate(std::int64_t x) {
  if (x > std::numeric_limits<std::int32_t>::max()) return std::numeric_limits<std::int32_t>::max();
  if (x < std::numeric_limits<std::int32_t>::min()) return std::numeric_limits<std::int32_t>::min();
  return static_cast<std::int32_t>(x);
}

// |x|; unsigned, because |INT32_MIN| does not fit a signed number.
constexpr std::uint32_t magnitude(std::int32_t x) {
  return x < 0 ? 0U - static_cast<std::uint32_t>(x) : static_cast<std::uint32_t>(x);
}

constexpr std::int64_t product(std::int32_t a, std::int32_t b) {
  return static_cast<std::int64_t>(a) * b;
}

// x / 2^kBits, rounded to nearest; the caller guarantees that the result fits 32 bits. On 32-bit
// ARM the shift leaves the bit that decides the rounding in the carry flag: two instructions
// instead of four, a tenth of all that a control cycle takes. The result is the same bit for bit.
template <int kBits>
constexpr std::int32_t rounded(std::int64_t x) {
  static_assert(kBits >= 1 && kBits <= 31);
#if defined(__arm__)
  if (!std::is_constant_evaluated()) {
    std::int32_t result;
    asm("lsrs %0, %Q1, %2\n\tadc %0, %0, %R1, lsl %3"
        : "=&r"(result)
        : "r"(x), "n"(kBits), "n"(32 - kBits)
        : "cc");
    return result;
  }
#endif
  return static_cast<std::int32_t>(round_shift(x, kBits));
}

// a · b / 2^kBits, rounded; the caller guarantees that the result fits 32 bits.
template <int kBits>
constexpr std::int32_t multiply(std::int32_t a, std::int32_t b) {
  return rounded<kBits>(product(a, b));
}

// a · b / 2^32 rounded: one multiply-accumulate instruction on a Cortex-M. |result| ≤ 2^30.
constexpr std::int32_t round_high(std::int32_t a, std::int32_t b) {
  return static_cast<std::int32_t>((product(a, b) + (std::int64_t{1} << 31)) >> 32);
}

// a · b / 2^32 rounded down: one instruction. For sums whose constants include the half unit.
constexpr std::int32_t high(std::int32_t a, std::int32_t b) {
  return static_cast<std::int32_t>(product(a, b) >> 32);
}

// Converts a coordinate in metre, within ±1, to a length.
constexpr Length length_of(Coordinate metre) {
  constexpr int kDown = Coordinate::fraction - Length::fraction;
  return {(metre.raw + (1 << (kDown - 1))) >> kDown};
}

// The low 32 bits of the turns: the angle within the turn.
constexpr BinaryAngle within_turn(JointPosition position) {
  return {static_cast<std::uint32_t>(static_cast<std::uint64_t>(position.raw))};
}

// Converts a prismatic joint variable, 2^-32 m, to a length.
constexpr Length length_of(JointPosition position) {
  return {saturate(round_shift(position.raw, 32 - Length::fraction))};
}

// Coordinate in radian to turns times 2^32: 2^32 / (2 π) / 2^30 = 0.63661977…, times 2^31.
inline constexpr std::int32_t kTurnsPerRadian = 1367130551;
constexpr std::int32_t turns_of(Coordinate radian) {
  return multiply<31>(radian.raw, kTurnsPerRadian);
}

// Coordinate in metre to 2^-32 m; the caller keeps it within ±0.5 m.
constexpr std::int32_t metres_of(Coordinate metre) { return saturate(product(metre.raw, 4)); }

// Largest sum on one coordinate, 0.5 rad or m: keeps the chain's arithmetic in range.
inline constexpr std::int32_t kMaxCoordinate = std::int32_t{1} << (Coordinate::fraction - 1);

// Adds a term to a coordinate, which saturates at ±kMaxCoordinate; returns true if it did.
// Precondition: |value| ≤ 2^30, so that the sum does not overflow.
constexpr bool add_to(Coordinate& sum, std::int32_t value) {
  const std::int32_t wide = sum.raw + value;
  if (wide > kMaxCoordinate || wide < -kMaxCoordinate) {
    sum.raw = wide < 0 ? -kMaxCoordinate : kMaxCoordinate;
    return true;
  }
  sum.raw = wide;
  return false;
}

// An unsigned normalised reciprocal: for d in 1 … 2^31, finds r and e with 1/d ≈ r · 2^(e-62) and
// r in [2^30, 2^31]; the relative error is below 2^-29. 1/d is then (r << e) >> 62 in exact
// arithmetic.
struct Reciprocal {
  std::uint32_t mantissa;
  int exponent;
};

constexpr Reciprocal reciprocal(std::uint32_t d) {
  const int shift = std::countl_zero(d);
  const std::uint32_t normal = d << shift;  // in [2^31, 2^32)
  // Seed: 2^46 / the upper 16 bits, good to 2^-15; one Newton step x(2 - dx) squares that.
  const std::uint32_t seed = 0x7FFFFFFFU / (normal >> 16U);  // ≈ 2^47 / normal, in (2^15, 2^16]
  const std::uint64_t x = static_cast<std::uint64_t>(seed) << 15U;  // Q62 / normal, in (2^30, 2^31]
  // d · x is close to 2^62; e = 2 - d·x / 2^62 in Q31.
  const std::uint64_t dx = (static_cast<std::uint64_t>(normal) * x) >> 31U;  // Q31, about 2^31
  const std::uint64_t e = (std::uint64_t{1} << 32U) - dx;
  const std::uint64_t improved = (x * e + (std::uint64_t{1} << 30U)) >> 31U;
  const std::uint64_t top = std::uint64_t{1} << 31U;
  return {static_cast<std::uint32_t>(improved > top ? top : improved), shift};
}

}  // namespace armtrue

#endif  // ARMTRUE_FIRMWARE_CORE_FIXED_FIXED_H_
