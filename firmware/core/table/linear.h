// Vectors and frames in fixed point, and the steps of a kinematic chain on them.
//
// The chain is evaluated in two ways: forward, frame by frame from the base, if whole frames are
// needed; backward, carrying vectors from the tool to the base, if only the tool is needed, which
// is a fifth of the work. Everything is inline, because these are the innermost steps of the joint
// path.
#ifndef ARMTRUE_FIRMWARE_CORE_TABLE_LINEAR_H_
#define ARMTRUE_FIRMWARE_CORE_TABLE_LINEAR_H_

#include <array>
#include <cstddef>
#include <cstdint>

#include "firmware/core/fixed/angle.h"
#include "firmware/core/fixed/bytes.h"
#include "firmware/core/fixed/fixed.h"
#include "firmware/core/table/format.h"

namespace armtrue {

// Three components in a format that the context names: a position (Q27 m), an axis (Q30), a mass
// moment (fraction bits of its set).
struct Vector {
  std::int32_t x;
  std::int32_t y;
  std::int32_t z;
};

// A frame seen from the base: the columns of its rotation (its axes, Q30) and its origin (Q27).
struct Frame {
  Vector x;
  Vector y;
  Vector z;
  Vector origin;
};

inline constexpr Frame kBaseFrame = {
    {kRatioOne.raw, 0, 0}, {0, kRatioOne.raw, 0}, {0, 0, kRatioOne.raw}, {0, 0, 0}};

// Motion of a joint: a rotation about z or a translation along z.
struct JointMotion {
  std::int32_t sine;    // Q30
  std::int32_t cosine;  // Q30
  std::int32_t slide;   // Q27 m
};

// A fixed transform of the table. Nearly always it turns about x alone (every DH and MDH row does),
// which takes 4 multiplications instead of 9.
struct FixedTransform {
  const std::uint8_t* at = nullptr;  // format::transform
  bool is_about_x = false;

  constexpr std::int32_t element(std::size_t row, std::size_t column) const {
    return load_i32(at + 12 * row + 4 * column);
  }
  constexpr Vector translation() const {
    const std::uint8_t* t = at + format::transform::kTranslationAt;
    return {load_i32(t), load_i32(t + 4), load_i32(t + 8)};
  }
};

// Sum of Q30 products, rounded back to the format of the other factor.
constexpr std::int32_t narrow(std::int64_t wide) { return rounded<Ratio::fraction>(wide); }

// The same without the last two bits, in half the instructions, where 2^-28 of full scale is enough
// (gravity, first-order shifts, Jacobians).
constexpr std::int32_t narrow_roughly(std::int64_t wide) {
  return static_cast<std::int32_t>(
      static_cast<std::uint32_t>(static_cast<std::uint64_t>(wide) >> 32U)
      << (32 - Ratio::fraction));
}

using Narrow = std::int32_t (*)(std::int64_t);

// Wraps instead of overflowing. Accepted tables do not reach that far; if one did, the result would
// still be defined and the correction clamped.
constexpr std::int32_t wrapping_sum(std::int32_t a, std::int32_t b) {
  return static_cast<std::int32_t>(static_cast<std::uint32_t>(a) + static_cast<std::uint32_t>(b));
}

constexpr std::int32_t wrapping_difference(std::int32_t a, std::int32_t b) {
  return static_cast<std::int32_t>(static_cast<std::uint32_t>(a) - static_cast<std::uint32_t>(b));
}

constexpr Vector sum(const Vector& a, const Vector& b) {
  return {wrapping_sum(a.x, b.x), wrapping_sum(a.y, b.y), wrapping_sum(a.z, b.z)};
}

// a × b, one of them Q30. No component of a may be the smallest number, because a is negated.
// Written as sums of products only, so that each is a multiply-accumulate.
template <Narrow kNarrow = narrow>
constexpr Vector cross(const Vector& a, const Vector& b) {
  return {kNarrow(product(a.y, b.z) + product(-a.z, b.y)),
          kNarrow(product(a.z, b.x) + product(-a.x, b.z)),
          kNarrow(product(a.x, b.y) + product(-a.y, b.x))};
}

// x · a + y · b + z · c for Q30 factors x, y, z.
template <Narrow kNarrow = narrow>
constexpr Vector combine(const Vector& a, std::int32_t x, const Vector& b, std::int32_t y,
                         const Vector& c, std::int32_t z) {
  return {kNarrow(product(a.x, x) + product(b.x, y) + product(c.x, z)),
          kNarrow(product(a.y, x) + product(b.y, y) + product(c.y, z)),
          kNarrow(product(a.z, x) + product(b.z, y) + product(c.z, z))};
}

template <Narrow kNarrow = narrow>
constexpr Vector combine(const Vector& a, std::int32_t x, const Vector& b, std::int32_t y) {
  return {kNarrow(product(a.x, x) + product(b.x, y)), kNarrow(product(a.y, x) + product(b.y, y)),
          kNarrow(product(a.z, x) + product(b.z, y))};
}

// Rotation of `fixed` times v.
template <Narrow kNarrow = narrow>
constexpr Vector rotate(const FixedTransform& fixed, const Vector& v) {
  if (fixed.is_about_x) {
    return {v.x, kNarrow(product(fixed.element(1, 1), v.y) + product(fixed.element(1, 2), v.z)),
            kNarrow(product(fixed.element(2, 1), v.y) + product(fixed.element(2, 2), v.z))};
  }
  const auto row = [&fixed, &v](std::size_t i) {
    return kNarrow(product(fixed.element(i, 0), v.x) + product(fixed.element(i, 1), v.y) +
                   product(fixed.element(i, 2), v.z));
  };
  return {row(0), row(1), row(2)};
}

// Transposed rotation of `fixed` times v.
template <Narrow kNarrow = narrow>
constexpr Vector rotate_back(const FixedTransform& fixed, const Vector& v) {
  if (fixed.is_about_x) {
    return {v.x, kNarrow(product(fixed.element(1, 1), v.y) + product(fixed.element(2, 1), v.z)),
            kNarrow(product(fixed.element(1, 2), v.y) + product(fixed.element(2, 2), v.z))};
  }
  const auto column = [&fixed, &v](std::size_t i) {
    return kNarrow(product(fixed.element(0, i), v.x) + product(fixed.element(1, i), v.y) +
                   product(fixed.element(2, i), v.z));
  };
  return {column(0), column(1), column(2)};
}

// Rz(θ) v and Rz(-θ) v.
template <Narrow kNarrow = narrow>
constexpr Vector rotate(const JointMotion& joint, const Vector& v) {
  return {kNarrow(product(v.x, joint.cosine) + product(v.y, -joint.sine)),
          kNarrow(product(v.x, joint.sine) + product(v.y, joint.cosine)), v.z};
}
template <Narrow kNarrow = narrow>
constexpr Vector rotate_back(const JointMotion& joint, const Vector& v) {
  return {kNarrow(product(v.x, joint.cosine) + product(v.y, joint.sine)),
          kNarrow(product(v.y, joint.cosine) + product(v.x, -joint.sine)), v.z};
}

// exp([r]×) v for a small rotation vector r, Q30 radian, in second order: v + r × (v + ½ r × v).
// The error is t³/6 of v: 6e-9 at 3.3 mrad.
constexpr Vector rotate_small(const Vector& r, const Vector& v) {
  const Vector first = cross(r, v);
  const Vector middle = {wrapping_sum(v.x, (first.x + 1) >> 1),
                         wrapping_sum(v.y, (first.y + 1) >> 1),
                         wrapping_sum(v.z, (first.z + 1) >> 1)};
  return sum(v, cross(r, middle));
}

// r (1 - t²/6), t = |r|: with it rotate_small() is exact to t⁴/24 of v, 4e-10 at 10 mrad.
constexpr Vector shortened(const Vector& r) {
  constexpr std::int32_t kSixth = 715827883;  // 2^32 / 6
  const std::int32_t square = narrow(product(r.x, r.x) + product(r.y, r.y) + product(r.z, r.z));
  const std::int32_t shrink = round_high(square, kSixth);
  return {r.x - narrow(product(r.x, shrink)), r.y - narrow(product(r.y, shrink)),
          r.z - narrow(product(r.z, shrink))};
}

// base_from_frame ← base_from_frame · fixed
constexpr void advance(Frame& frame, const FixedTransform& fixed) {
  const Vector t = fixed.translation();
  frame.origin = sum(frame.origin, combine(frame.x, t.x, frame.y, t.y, frame.z, t.z));
  const Vector x = frame.x;
  const Vector y = frame.y;
  const Vector z = frame.z;
  if (fixed.is_about_x) {
    frame.y = combine(y, fixed.element(1, 1), z, fixed.element(2, 1));
    frame.z = combine(y, fixed.element(1, 2), z, fixed.element(2, 2));
    return;
  }
  frame.x = combine(x, fixed.element(0, 0), y, fixed.element(1, 0), z, fixed.element(2, 0));
  frame.y = combine(x, fixed.element(0, 1), y, fixed.element(1, 1), z, fixed.element(2, 1));
  frame.z = combine(x, fixed.element(0, 2), y, fixed.element(1, 2), z, fixed.element(2, 2));
}

// base_from_frame ← base_from_frame · joint
constexpr void advance(Frame& frame, const JointMotion& joint) {
  const Vector x = frame.x;
  const Vector y = frame.y;
  frame.x = combine(x, joint.cosine, y, joint.sine);
  frame.y = combine(y, joint.cosine, x, -joint.sine);
  if (joint.slide != 0) {
    frame.origin = sum(frame.origin, {narrow(product(frame.z.x, joint.slide)),
                                      narrow(product(frame.z.y, joint.slide)),
                                      narrow(product(frame.z.z, joint.slide))});
  }
}

}  // namespace armtrue

#endif  // ARMTRUE_FIRMWARE_CORE_TABLE_LINEAR_H_
