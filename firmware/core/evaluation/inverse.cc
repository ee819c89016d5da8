#include "firmware/core/evaluation/inverse.h"

#include "firmware/core/evaluation/second_order.h"

namespace armtrue {
namespace {

// Rotation vector from the real to the wanted tool, ½ Σ real axis × wanted axis: correct to first
// order in the angle, which is enough for a step of Newton's method.
Vector rotation_error(const RealTool& real, const Frame& wanted) {
  const Vector x = cross(real.x, wanted.x);
  const Vector y = cross(real.y, wanted.y);
  const Vector z = cross(cross(real.x, real.y), wanted.z);
  const auto half = [](std::int32_t a, std::int32_t b, std::int32_t c) {
    return static_cast<std::int32_t>(round_shift(static_cast<std::int64_t>(a) + b + c, 1));
  };
  return {half(x.x, y.x, z.x), half(x.y, y.y, z.y), half(x.z, y.z, z.z)};
}

Coordinate shift_between(std::int32_t wanted, std::int32_t real) {
  const std::int64_t difference = static_cast<std::int64_t>(wanted) - real;
  return {saturate(difference * (1 << (Coordinate::fraction - Length::fraction)))};
}

ToolError tool_error(const TableView& table, const Frame& wanted, const RealTool& real) {
  ToolError error;
  error[0] = shift_between(wanted.origin.x, real.point.x);
  error[1] = shift_between(wanted.origin.y, real.point.y);
  error[2] = shift_between(wanted.origin.z, real.point.z);
  if (table.is_full_pose()) {
    const Vector turn = rotation_error(real, wanted);
    const std::int32_t length = table.rotation_length().raw;
    error[3] = {multiply<Length::fraction>(turn.x, length)};
    error[4] = {multiply<Length::fraction>(turn.y, length)};
    error[5] = {multiply<Length::fraction>(turn.z, length)};
  }
  return error;
}

JacobianColumn prismatic_column(const Vector& axis) {
  constexpr int kDown = Ratio::fraction - kJacobianFraction;
  return {static_cast<std::int32_t>(round_shift(axis.x, kDown)),
          static_cast<std::int32_t>(round_shift(axis.y, kDown)),
          static_cast<std::int32_t>(round_shift(axis.z, kDown)),
          0,
          0,
          0};
}

// axis × arm, and for the full pose the axis times the rotation length.
JacobianColumn revolute_column(const Vector& axis, const Vector& arm, const TableView& table) {
  constexpr int kDown = Ratio::fraction + Length::fraction - kJacobianFraction - 32;
  const auto narrow_column = [](std::int64_t wide) {
    return static_cast<std::int32_t>(wide >> 32) >> kDown;
  };
  JacobianColumn column;
  column[0] = narrow_column(product(axis.y, arm.z) - product(axis.z, arm.y));
  column[1] = narrow_column(product(axis.z, arm.x) - product(axis.x, arm.z));
  column[2] = narrow_column(product(axis.x, arm.y) - product(axis.y, arm.x));
  if (table.is_full_pose()) {
    const std::int32_t length = table.rotation_length().raw;
    column[3] = narrow_column(product(axis.x, length));
    column[4] = narrow_column(product(axis.y, length));
    column[5] = narrow_column(product(axis.z, length));
  }
  return column;
}

// Geometric Jacobian of the links, then of the motors: column j of J C (Siciliano et al., Robotics,
// 3.1.3).
void make_jacobian(const TableView& table, const Frames& frames, const Vector& tool,
                   Jacobian& jacobian) {
  const std::size_t joints = table.joint_count();
  for (std::size_t k = 0; k < joints; ++k) {
    const Vector& origin = frames[k].origin;
    const Vector arm = {wrapping_difference(tool.x, origin.x),
                        wrapping_difference(tool.y, origin.y),
                        wrapping_difference(tool.z, origin.z)};
    jacobian[k] = table.is_prismatic(k) ? prismatic_column(frames[k].z)
                                        : revolute_column(frames[k].z, arm, table);
  }
  const SectionView& coupling = table.section(format::Section::kCoupling);
  if (coupling.count == 0U) return;
  const Jacobian links = jacobian;
  for (std::size_t n = 0; n < coupling.count; ++n) {
    const std::uint8_t* entry = coupling.begin + n * format::coupling::kLength;
    const JacobianColumn& driven = links[entry[format::coupling::kRowAt]];
    JacobianColumn& driving = jacobian[entry[format::coupling::kColumnAt]];
    const std::int32_t ratio = load_i32(entry + format::coupling::kRatioAt);
    const std::size_t rows = table.is_full_pose() ? kMaxRows : 3U;
    for (std::size_t i = 0; i < rows; ++i) {
      driving[i] += multiply<format::coupling::kRatioFraction>(driven[i], ratio);
    }
  }
}

// Passive joints have no motor. Their Jacobian columns are zeroed, so that the other joints alone
// correct the tool, and terms on their motor side are added to the link positions, because no motor
// can compensate them.
[[gnu::noinline]] void leave_to_bars(const TableView& table, Workspace& work) {
  for (std::size_t k = 0; k < table.joint_count(); ++k) {
    if (!table.is_passive(k)) continue;
    work.jacobian[k] = {};
    work.link[k].raw += position_step(table, k, work.coordinates[k]);
    work.coordinates[k] = {};
  }
  joint_motions(table, work.link, work.motions);
}

void take_share(Ratio share, std::size_t joints, JointStep& step) {
  if (share == kRatioOne) return;
  for (std::size_t k = 0; k < joints; ++k) {
    step[k].raw = multiply<Ratio::fraction>(step[k].raw, share.raw);
  }
}

// Solves x + s(x) = c for one motor, where s are its steep terms, known at two positions `from` and
// `to`. `moved` is to - from, `change` s(to) - s(from), `missing` c - s(to) - to. Returns x - to by
// the secant through both positions. If the joint hardly moved, or another joint caused the change,
// it returns `missing`, which is one fixed-point iteration. All Q30.
std::int32_t secant_step(std::int32_t moved, std::int32_t change, std::int32_t missing) {
  constexpr std::int32_t kOne = 1 << 10;
  constexpr std::int32_t kSteepest = kOne / 4;
  constexpr std::int32_t kMost = 1 << 20;  // 1 mrad: keeps the quotient in 32 bits
  if (moved == 0 || change > kMost || change < -kMost) return missing;
  const std::int32_t slope = change * kOne / moved;
  if (slope > kSteepest || slope < -kSteepest) return missing;
  return multiply<10>(missing, kOne * kOne / (kOne + slope));
}

}  // namespace

Correction solve(const TableView& table, const JointPositions& target,
                 const Surroundings& surroundings, Workspace& work) {
  const std::size_t joints = table.joint_count();
  const std::size_t rows = table.is_full_pose() ? 6 : 3;
  Coordinates& coordinates = work.coordinates;
  JointPositions& link = work.moved_link;

  // 1. At the target.
  begin_terms(table, surroundings, work.terms);
  link_positions(table, target, work.link);
  joint_motions(table, work.link, work.motions);
  const Frame wanted = nominal_tool(table, work.motions, work.frames);
  make_jacobian(table, work.frames, wanted.origin, work.jacobian);
  update_gravity(table, work.motions, work.terms);
  MotorCoordinates steep;
  evaluate_steep_terms(table, target, work.link, work.terms, steep);
  evaluate_smooth_terms(table, target, work.link, work.motions, work.terms, coordinates);
  if (table.passive() != 0U) leave_to_bars(table, work);
  work.solver.factor(work.jacobian, joints, rows, table.damping());
  JointStep step =
      work.solver.step(tool_error(table, wanted, real_tool(table, work.motions, coordinates)));
  const Ratio share = straight_share(table, work.frames, wanted.origin, step);
  JointPositions corrected;
  JointStep moved;  // since the last evaluation of the steep terms
  for (std::size_t k = 0; k < joints; ++k) {
    moved[k] = {wrapping_difference(step[k].raw, coordinates[k].raw + steep[k].raw)};
  }
  // Deflections too: in full, beside a share of the step, they may move the tool further off.
  take_share(share, joints, moved);
  for (std::size_t k = 0; k < joints; ++k) {
    corrected[k].raw = target[k].raw + position_step(table, k, moved[k]);
  }

  // 2. At q₁, which is moved by the change of the steep terms since the target.
  link_positions(table, corrected, link);
  MotorCoordinates steep_there;
  evaluate_steep_terms(table, corrected, link, work.terms, steep_there);
  for (std::size_t k = 0; k < joints; ++k) {
    const std::int32_t change = steep_there[k].raw - steep[k].raw;
    moved[k] = {secant_step(moved[k].raw, change, -change)};
    steep[k].raw = wrapping_difference(steep[k].raw, moved[k].raw);  // x + s(x) is kept
    corrected[k].raw += position_step(table, k, moved[k]);
  }
  link_positions(table, corrected, link);
  turn_motions(table, work.link, link, work.motions);
  // A corrected arm that bends under its loads stands at the target, so its loads stay those of the
  // target. Where the fit found loads to act at the commanded angles, they are those of q₁.
  if (table.do_loads_act_at_command()) {
    update_gravity(table, work.motions, work.terms);
  }
  evaluate_smooth_terms(table, corrected, link, work.motions, work.terms, coordinates);
  JointPositions deflected;
  for (std::size_t k = 0; k < joints; ++k) {
    deflected[k].raw =
        corrected[k].raw + position_step(table, k, {steep[k].raw + coordinates[k].raw});
  }
  link_positions(table, deflected, link);
  joint_motions(table, link, work.motions);
  step = work.solver.step(tool_error(table, wanted, real_tool(table, work.motions, coordinates)));
  take_share(share, joints, step);
  for (std::size_t k = 0; k < joints; ++k) {
    moved[k].raw = wrapping_sum(moved[k].raw, step[k].raw);
    corrected[k].raw += position_step(table, k, step[k]);
  }

  // 3. Steep terms once more.
  link_positions(table, corrected, link);
  MotorCoordinates steep_last;
  evaluate_steep_terms(table, corrected, link, work.terms, steep_last);
  Correction correction;
  for (std::size_t k = 0; k < joints; ++k) {
    const Coordinate last = {secant_step(moved[k].raw, steep_last[k].raw - steep_there[k].raw,
                                         steep[k].raw - steep_last[k].raw)};
    const std::int64_t delta = corrected[k].raw - target[k].raw + position_step(table, k, last);
    correction.delta[k] = saturate(delta);
    correction.is_saturated = correction.is_saturated || correction.delta[k] != delta;
  }
  correction.is_near_singular = work.solver.is_near_singular() || share != kRatioOne;
  correction.is_outside_coverage = work.terms.flags.is_outside_coverage;
  correction.is_saturated = correction.is_saturated || work.terms.flags.is_saturated;
  return correction;
}

}  // namespace armtrue
