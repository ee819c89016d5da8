#include "firmware/core/evaluation/kinematics.h"

namespace armtrue {
namespace {

struct Displacement {
  Vector shift;  // Q27 m
  Vector turn;   // Q30 rad
};

// The virtual joint of a frame.
Displacement motion_of(const Coordinates& coordinates, std::size_t frame) {
  const Coordinate* at = &coordinates[format::kMotorCoordinates + 6 * frame];
  return {{length_of(at[0]).raw, length_of(at[1]).raw, length_of(at[2]).raw},
          {at[3].raw, at[4].raw, at[5].raw}};
}

void apply_virtual_joint(const TableView& table, const Coordinates& coordinates, std::size_t frame,
                         RealTool& tool) {
  if (!table.has_motion(frame)) return;
  Displacement motion = motion_of(coordinates, frame);
  if (table.has_large_turn(frame)) {
    motion.turn = shortened(motion.turn);
  }
  tool.point = sum(rotate_small(motion.turn, tool.point), motion.shift);
  if (table.is_full_pose()) {
    tool.x = rotate_small(motion.turn, tool.x);
    tool.y = rotate_small(motion.turn, tool.y);
  }
}

void apply_fixed(const FixedTransform& fixed, bool is_full_pose, RealTool& tool) {
  tool.point = sum(rotate(fixed, tool.point), fixed.translation());
  if (is_full_pose) {
    tool.x = rotate(fixed, tool.x);
    tool.y = rotate(fixed, tool.y);
  }
}

}  // namespace

void link_positions(const TableView& table, const JointPositions& motor, JointPositions& link) {
  for (std::size_t k = 0; k < table.joint_count(); ++k) {
    link[k].raw = motor[k].raw + load_i64(table.joint(k) + format::joint::kOffsetAt);
  }
  const SectionView& coupling = table.section(format::Section::kCoupling);
  for (std::size_t i = 0; i < coupling.count; ++i) {
    const std::uint8_t* entry = coupling.begin + i * format::coupling::kLength;
    const std::int32_t ratio = load_i32(entry + format::coupling::kRatioAt);
    // Only the low 64 bits of the product matter: ±8 turns remain after the shift. Unsigned,
    // because adding the half for rounding may exceed the largest signed number.
    constexpr std::uint64_t kHalf = std::uint64_t{1} << (format::coupling::kRatioFraction - 1);
    const std::uint64_t driven =
        static_cast<std::uint64_t>(motor[entry[format::coupling::kColumnAt]].raw) *
        static_cast<std::uint64_t>(static_cast<std::int64_t>(ratio));
    link[entry[format::coupling::kRowAt]].raw +=
        static_cast<std::int64_t>(driven + kHalf) >> format::coupling::kRatioFraction;
  }
}

void turn_motions(const TableView& table, const JointPositions& from, const JointPositions& to,
                  JointMotions& motions) {
  // 2 π / 2^32 of the turns, Q30: 2 π · 2^30 / 2^32, times 2^30.
  constexpr std::int32_t kRadianPerTurn = 1686629713;
  for (std::size_t k = 0; k < table.joint_count(); ++k) {
    if (table.is_prismatic(k)) {
      motions[k].slide = length_of(to[k]).raw;
      continue;
    }
    const std::int32_t turns = saturate(to[k].raw - from[k].raw);
    const std::int32_t angle = multiply<30>(turns, kRadianPerTurn);
    const std::int32_t half_square = multiply<31>(angle, angle);
    const JointMotion before = motions[k];
    motions[k].sine =
        wrapping_difference(wrapping_sum(before.sine, narrow(product(before.cosine, angle))),
                            narrow(product(before.sine, half_square)));
    motions[k].cosine =
        wrapping_difference(wrapping_difference(before.cosine, narrow(product(before.sine, angle))),
                            narrow(product(before.cosine, half_square)));
  }
}

void joint_motions(const TableView& table, const JointPositions& link, JointMotions& motions) {
  for (std::size_t k = 0; k < table.joint_count(); ++k) {
    if (table.is_prismatic(k)) {
      motions[k] = {0, kRatioOne.raw, length_of(link[k]).raw};
    } else {
      const BinaryAngle angle = within_turn(link[k]);
      motions[k] = {sine(angle).raw, cosine(angle).raw, 0};
    }
  }
}

Frame nominal_tool(const TableView& table, const JointMotions& motions, Frames& frames) {
  Frame frame = kBaseFrame;
  for (std::size_t k = 0; k < table.joint_count(); ++k) {
    advance(frame, table.fixed(k));
    advance(frame, motions[k]);
    frames[k] = frame;
  }
  if (table.is_full_pose()) {
    advance(frame, table.tool());
  } else {
    // The tool's axes are not needed.
    const Vector t = table.tool().translation();
    frame.origin = sum(frame.origin, combine(frame.x, t.x, frame.y, t.y, frame.z, t.z));
  }
  return frame;
}

RealTool real_tool(const TableView& table, const JointMotions& motions,
                   const Coordinates& coordinates) {
  const bool is_full_pose = table.is_full_pose();
  RealTool tool = {{}, {kRatioOne.raw, 0, 0}, {0, kRatioOne.raw, 0}};
  apply_virtual_joint(table, coordinates, format::kToolFrame, tool);
  apply_fixed(table.tool(), is_full_pose, tool);
  for (std::size_t k = table.joint_count(); k-- > 0;) {
    apply_virtual_joint(table, coordinates, k + 1, tool);
    tool.point = rotate(motions[k], tool.point);
    tool.point.z = wrapping_sum(tool.point.z, motions[k].slide);
    if (is_full_pose) {
      tool.x = rotate(motions[k], tool.x);
      tool.y = rotate(motions[k], tool.y);
    }
    apply_fixed(table.fixed(k), is_full_pose, tool);
  }
  apply_virtual_joint(table, coordinates, 0, tool);
  return tool;
}

}  // namespace armtrue
