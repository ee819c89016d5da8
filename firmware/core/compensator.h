// The joint path: targets in, corrected targets out, once per control cycle.
//
//   Compensator compensator(config);
//   compensator.load(image, device);   // validates; the table waits
//   compensator.activate();            // it is in force: the next cycle begins to blend it in
//   CycleOutput out = compensator.cycle(in);   // every cycle
//   plain = bounds(k).wrapped(actual - correction_of(out.cycle, k));   // when feedback comes
//
// Safe by construction: without a valid table the output is the input, bit for bit. Enabling,
// disabling and switching blend over a set time from whatever correction was last put out.
// Corrections and their rate are limited by the signed table, capped by limits.h, and every clamp
// is counted. A correction larger than one joint may have is made smaller at all joints alike
// (correction_limits.h). No heap, no floating point, no recursion.
//
// One context calls everything. The image of a table that waits or is in force must not change:
// is_in_use() tells. Limits and scales are copied out when it is put in force, so that a way to
// zero reads no image at all.
#ifndef ARMTRUE_FIRMWARE_CORE_COMPENSATOR_H_
#define ARMTRUE_FIRMWARE_CORE_COMPENSATOR_H_

#include <array>
#include <cstdint>
#include <span>

#include "firmware/core/evaluation/correction_limits.h"
#include "firmware/core/evaluation/inverse.h"
#include "firmware/core/table/limits.h"
#include "firmware/core/table/table.h"
#include "firmware/core/table/table_view.h"

namespace armtrue {

// What the controller tells in one cycle. Targets in the drives' own increments (CiA 402 0x607A).
struct CycleInput {
  std::array<std::int32_t, kMaxJoints> target = {};
  std::array<std::int32_t, kMaxSensors> temperature_mdegc = {};  // 0.001 °C, in the table's order
  std::uint32_t temperature_valid =
      0;                       // bit s: sensor s is known; otherwise its reference is taken
  std::int32_t payload_g = 0;  // mass at the tool point, gram
  std::uint64_t time_ms = 0;   // since start of the device, taken for that of the arm
  // Since the cycle before. More than the control period counts as the period: a pause earns no
  // step.
  std::uint32_t elapsed_us = UINT32_MAX;
  // Bit k: joint k gets no output in this cycle; its correction stays where it is.
  std::uint8_t held = 0;
};

// Where a joint's positions lie, in increments. A range narrower than all of 32 bits is one that
// positions wrap around in (0x607B); limits are the drive's (0x607D).
struct PositionBounds {
  std::int32_t range_low = INT32_MIN;
  std::int32_t range_high = INT32_MAX;
  std::int32_t limit_low = INT32_MIN;
  std::int32_t limit_high = INT32_MAX;

  bool wraps() const {
    return range_low < range_high && (range_low != INT32_MIN || range_high != INT32_MAX);
  }
  // A position within the range, as the drive counts it.
  std::int32_t wrapped(std::int64_t position) const;
  // A way from one position to another: the short one where positions wrap.
  std::int64_t way(std::int64_t way) const;
  // `corrected` no further than a limit that `plain` respects. Continuous in both, so that no step
  // is made where the plain target itself passes the limit. Of bounds in force.
  std::int64_t within_limits(std::int64_t corrected, std::int32_t plain) const;
  // What a range that positions wrap in means for limits: its ends are limits as well, unless all
  // of it is permitted. Limits that permit none of it are none.
  PositionBounds in_force() const;
};

// What the compensator is doing.
enum class CompensatorState : std::uint8_t {
  kPassThrough = 0,  // no table active: delta is zero, output equals input exactly
  kBlending = 1,     // on the way to an active table, to another, or to none
  kActive = 2,
};

// What happened in one cycle, combined with bitwise or.
enum CycleFlags : std::uint16_t {
  kCycleClean = 0,
  kMagnitudeClamped = 1U << 0,  // a joint's was larger than the table allows: all were scaled
  kRateClamped = 1U << 1,       // a correction wanted to change faster than the table allows
  kNearSingular = 1U << 2,      // the damping took more than 1 % of a step's length
  kOutsideCoverage = 1U << 3,   // some 1-D table or grid was outside what it was trained on
  kStateSaturated = 1U << 4,    // an input was outside the range that the format can hold
  kOutputSaturated = 1U << 5,   // target plus correction left the 32-bit range
  kAtPositionLimit = 1U << 6,   // a corrected target was kept from passing a software limit
};

// Cycles in which each thing happened, since construction. They stop at their maximum.
struct CycleCounters {
  std::uint32_t cycles = 0;
  std::uint32_t magnitude_clamped = 0;
  std::uint32_t rate_clamped = 0;
  std::uint32_t output_saturated = 0;
  // By joint: cycles in which it was held back by a limit of its own (magnitude, rate, position,
  // 32-bit range). A correction beyond the magnitude of one joint makes all of them smaller; it is
  // counted for that one.
  std::array<std::uint32_t, kMaxJoints> clamped = {};
};

struct CycleOutput {
  std::array<std::int32_t, kMaxJoints> corrected = {};  // what the drives are told, increments
  std::array<std::int32_t, kMaxJoints> delta = {};      // corrected - target, increments
  std::uint32_t cycle = 0;                              // pass it to correction_of()
  std::uint16_t flags = kCycleClean;
  CompensatorState state = CompensatorState::kPassThrough;
};

// What the device is set up for; fixed while it runs.
struct CompensatorConfig {
  std::uint8_t joint_count = 6;
  std::uint32_t cycle_us = 1000;  // control period: rate limits and blending are times
};

// What a joint's record says of its drive, and what follows from it for every cycle.
struct JointScale {
  JointScale() = default;
  JointScale(const TableView& table, std::size_t joint, std::uint32_t cycle_us);

  std::int32_t unit_per_increment = 0;
  std::int32_t increment_per_unit = 0;
  std::uint8_t unit_shift = 0;
  std::uint8_t increment_shift = 0;
  std::int32_t zero = 0;
  std::int32_t dead_band = 0;
  // Largest change of the correction in a control period, 2^-32 turn or metre.
  std::int32_t rate = 0;
  // Largest correction and its largest change in the drive's increments, by whichever of the two
  // scales gives less.
  std::int32_t magnitude_increments = 0;
  std::int32_t rate_increments = 0;
  // Increments of a turn or a metre; at most INT32_MAX.
  std::int32_t per_turn = 0;

  // 2^-32 turn or metre.
  std::int64_t units_of(std::int32_t increments) const;
  // Whether increments fall as the joint's position grows.
  bool counts_down() const { return unit_per_increment < 0; }
};

class Compensator {
 public:
  explicit Compensator(const CompensatorConfig& config);
  Compensator(const Compensator&) = delete;
  Compensator& operator=(const Compensator&) = delete;

  // Validates `image` against `device` and the configured joint count and, if accepted, keeps it as
  // the pending table (a pending table that was not activated is replaced). The image is referred
  // to, not copied.
  Validation load(std::span<const std::uint8_t> image, const DeviceIdentity& device);

  // Puts the pending table in force; the next cycles blend to it. False if none is pending.
  bool activate();

  // Pass-through: the next cycles blend the correction out. No image is read any more.
  void disable();

  // True while cycles read from `image` or activate() would put it in force.
  bool is_in_use(std::span<const std::uint8_t> image) const;

  // One control cycle. Constant work for a given table; bounded by tests/firmware/budget.
  CycleOutput cycle(const CycleInput& input);

  // The correction of `joint` in cycle `cycle`, increments: taken off the drive's actual position
  // (0x6064), the controller sees the arm that it commanded. 0 if the cycle lies further back than
  // kFeedbackHistory or has not been yet.
  std::int32_t correction_of(std::uint32_t cycle, std::size_t joint) const;

  // The last cycle's output goes to nobody: everything is as if there had not been that cycle, but
  // for the counters of what happened in it. What was asked since (another table, disable(), park()
  // and the others here) stays asked. Once for a cycle.
  void take_back();

  // The last cycle's output did not reach these joints (bit k: joint k): each holds what it held
  // before, and the next cycle goes on from there at the permitted rate. The others go on.
  void take_back_of(std::uint8_t joints);

  // The stream of commands was interrupted. A joint whose next target lies within the dead band of
  // its last keeps its direction of approach; of another it is forgotten.
  void restart_stream();
  // The joint was moved by something else than its targets.
  void forget_direction(std::size_t joint);

  // The drives stand `held` increments beyond their targets: the correction begins there, within
  // the table's limits. From there it blends to that of the table in force, or to zero while it is
  // disabled. From which side the joints were approached is not known. False if some of `held` was
  // beyond a limit. Ends park(). Before the first table the drives' scale is not known, and the
  // correction begins at zero. Before the first cycle, and where the drives may hold something else
  // than the last cycle's output.
  bool begin(std::span<const std::int32_t> held);
  // Nothing of what was begun has reached the drives: passes through until begin().
  void forget();

  // From the next cycle on the correction goes to zero at the permitted rate, until begin() or
  // resume(). It is there after kFadeCycles at most, whatever rate the table permits.
  void park();
  // Ends park(): blends from whatever is put out now.
  void resume();
  static constexpr std::uint32_t kFadeCycles = 2000;

  // On the way to zero: parked, disabled or without a table any more.
  bool is_fading() const {
    return motion_.state == CompensatorState::kBlending && (parked_ || !has_active_);
  }

  void set_bounds(std::size_t joint, const PositionBounds& bounds) {
    bounds_[joint] = bounds.in_force();
  }
  const PositionBounds& bounds(std::size_t joint) const { return bounds_[joint]; }
  // Bit k: joint k has no drive, by the table in force or the last that was; before the first table
  // every joint counts as one with a drive.
  std::uint8_t passive() const { return table_.passive(); }
  // Of the table in force, or of the last that was.
  const JointScale& scale(std::size_t joint) const { return scale_[joint]; }

  // What the table in force reads. Bit s: the temperature of sensor s, bit kMaxSensors: the
  // payload.
  std::uint32_t needed_inputs() const { return has_active_ ? needed_inputs_ : 0; }

  CompensatorState state() const { return motion_.state; }
  std::uint32_t cycle_us() const { return config_.cycle_us; }
  const CycleCounters& counters() const { return counters_; }

 private:
  // What one cycle leaves for the next.
  struct Motion {
    CompensatorState state = CompensatorState::kPassThrough;
    std::uint32_t blend_weight = 0;  // of the new correction in the running blend, Q30
    bool has_previous_target = false;
    std::array<std::int32_t, kMaxJoints> direction_anchor = {};
    std::array<std::int8_t, kMaxJoints> direction = {};    // -1, 0, +1: of the joint
    std::array<std::int32_t, kMaxJoints> delta = {};       // put out last, 2^-32 units
    std::array<std::int32_t, kMaxJoints> increments = {};  // the same in increments
    std::array<std::int32_t, kMaxJoints> delta_held = {};  // where the running blend began

    bool is_zero() const {
      constexpr std::array<std::int32_t, kMaxJoints> kNone = {};
      return delta == kNone && increments == kNone;
    }
  };

  // Whatever happens between two cycles happens to the last one's result and to what take_back()
  // would return to. Nothing but a cycle changes one of them alone.
  template <typename Change>
  void change(const Change& each) {
    each(motion_);
    each(before_);
  }

  bool corrects() const { return has_active_ && !parked_; }
  void redirect(std::uint32_t blend_weight);
  std::uint32_t share_of(std::uint32_t elapsed_us) const;
  Correction evaluate(const CycleInput& input, std::uint16_t& flags);
  void update_direction(const CycleInput& input);
  void blend(JointAmounts& aim) const;
  std::uint32_t move_corrections(JointAmounts& aim, std::uint32_t share, std::uint8_t held,
                                 std::uint16_t& flags);
  void put_out(const CycleInput& input, std::uint32_t share, std::uint32_t clamped,
               CycleOutput& output);
  std::int32_t limited(std::size_t joint, std::int32_t aim, std::uint32_t share,
                       std::uint16_t& flags) const;
  std::int32_t increments_of(std::size_t joint) const;
  std::int32_t within_last_limits(std::size_t joint, std::int32_t increments,
                                  std::uint32_t share) const;
  void count_cycle(std::uint16_t flags);

  CompensatorConfig config_;
  TableView table_;                        // in force, or the last that was
  std::span<const std::uint8_t> pending_;  // what load() accepted, empty for none
  bool has_active_ = false;                // table_ is evaluated
  bool parked_ = false;                    // but no correction is wanted
  // Of the table in force, or of the last that was.
  std::array<JointScale, kMaxJoints> scale_ = {};
  JointAmounts magnitude_ = {};  // largest correction
  std::array<PositionBounds, kMaxJoints> bounds_ = {};
  std::uint16_t blend_ms_ = 0;
  std::uint32_t blend_step_ = 0;  // growth of the blend's weight in a control period
  std::uint32_t needed_inputs_ = 0;
  std::uint32_t cycle_ = 0;
  Motion motion_;
  Motion before_;  // the last cycle
  std::array<std::array<std::int32_t, kMaxJoints>, kFeedbackHistory> history_ = {};
  std::array<std::int32_t, kMaxJoints> overwritten_ = {};  // row of history_, by the last cycle
  CycleCounters counters_;
  Workspace workspace_;
};

}  // namespace armtrue

#endif  // ARMTRUE_FIRMWARE_CORE_COMPENSATOR_H_
