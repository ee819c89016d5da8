#include "firmware/core/evaluation/second_order.h"

#include <bit>

#include "firmware/core/fixed/bytes.h"
#include "firmware/core/table/format.h"

namespace armtrue {
namespace {

// A quarter of a radian or metre, summed over all joints: the sums below then fit 32 bits.
constexpr int kTurnBits = Coordinate::fraction - 2;

// The tool's motion, metre, Q27.
struct ToolMotion {
  std::uint32_t way = 0;
  std::uint32_t bent = 0;
};

std::uint32_t size_of(const Vector& v) { return magnitude(v.x) + magnitude(v.y) + magnitude(v.z); }

std::uint32_t times(std::uint32_t angle, Length length) {
  return static_cast<std::uint32_t>(
      (static_cast<std::uint64_t>(angle) * static_cast<std::uint32_t>(length.raw)) >>
      Coordinate::fraction);
}

// The step of the links that the motors' step causes.
JointStep at_links(const TableView& table, const JointStep& motors) {
  JointStep links = motors;
  const SectionView& coupling = table.section(format::Section::kCoupling);
  for (std::size_t n = 0; n < coupling.count; ++n) {
    const std::uint8_t* entry = coupling.begin + n * format::coupling::kLength;
    Coordinate& driven = links[entry[format::coupling::kRowAt]];
    const std::int64_t by = product(motors[entry[format::coupling::kColumnAt]].raw,
                                    load_i32(entry + format::coupling::kRatioAt));
    driven.raw = saturate(driven.raw + round_shift(by, format::coupling::kRatioFraction));
  }
  return links;
}

ToolMotion motion_of(const TableView& table, const Frames& frames, const Vector& tool,
                     const JointStep& links, int down) {
  Vector way = {};
  Vector bent = {};
  Vector turned = {};
  Vector twisted = {};
  for (std::size_t k = 0; k < table.joint_count(); ++k) {
    const Frame& frame = frames[k];
    const std::int32_t by = links[k].raw >> down;
    const Vector own = {multiply<Ratio::fraction>(frame.z.x, by),
                        multiply<Ratio::fraction>(frame.z.y, by),
                        multiply<Ratio::fraction>(frame.z.z, by)};
    if (table.is_prismatic(k)) {
      constexpr int kDown = Coordinate::fraction - Length::fraction;
      const Vector shift = {own.x >> kDown, own.y >> kDown, own.z >> kDown};
      way = sum(way, shift);
      bent = sum(bent, cross(turned, shift));
      continue;
    }
    const Vector shift = cross(own, {wrapping_difference(tool.x, frame.origin.x),
                                     wrapping_difference(tool.y, frame.origin.y),
                                     wrapping_difference(tool.z, frame.origin.z)});
    way = sum(way, shift);
    bent = sum(bent, cross(sum(turned, {own.x >> 1, own.y >> 1, own.z >> 1}), shift));
    if (table.is_full_pose()) twisted = sum(twisted, cross(turned, own));
    turned = sum(turned, own);
  }
  ToolMotion motion = {size_of(way), size_of(bent)};
  if (table.is_full_pose()) {
    motion.way += times(size_of(turned), table.rotation_length());
    motion.bent += times(size_of(twisted) / 2U, table.rotation_length());
  }
  return motion;
}

}  // namespace

Ratio straight_share(const TableView& table, const Frames& frames, const Vector& tool,
                     const JointStep& step) {
  const JointStep links = at_links(table, step);
  std::uint64_t turns = 0;
  for (std::size_t k = 0; k < table.joint_count(); ++k) turns += magnitude(links[k].raw);
  // Large steps are evaluated 2^down times smaller, which makes the bending 4^down times smaller.
  const int wide = 64 - std::countl_zero(turns) - kTurnBits;
  const int down = wide > 0 ? wide : 0;
  const ToolMotion motion = motion_of(table, frames, tool, links, down);
  const std::uint64_t limit = (static_cast<std::uint64_t>(motion.bent) * 8U) << down;
  if (limit <= motion.way) return kRatioOne;
  // way / limit below 1, with 30 fraction bits.
  const int excess = 33 - std::countl_zero(limit);
  const int narrow = excess > 0 ? excess : 0;
  const Reciprocal inverse = reciprocal(static_cast<std::uint32_t>(limit >> narrow));
  const std::uint64_t quotient = static_cast<std::uint64_t>(motion.way) * inverse.mantissa;
  return {static_cast<std::int32_t>(quotient >> (32 - inverse.exponent + narrow))};
}

}  // namespace armtrue
