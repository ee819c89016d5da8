// The joint path: targets in, corrected targets out, once per control cycle.
//
//   Compensator compensator(config);
//   compensator.load(image, device);   // validates; the table is pending
//   compensator.activate();            // puts it in force; the next cycle begins to blend it in
//   CycleOutput out = compensator.cycle(in);   // every cycle
//   plain = bounds(k).wrapped(actual - correction_of(out.cycle, k));   // for each feedback
//
// Without a valid table the output equals the input, bit for bit. Enabling, disabling and switching
// blend over a set time, starting from the last correction that was output. The signed table limits
// corrections and their rate, capped by limits.h, and every clamp is counted. If one joint's
// correction exceeds its limit, all joints are scaled by the same factor (correction_limits.h). No
// heap, no floating point, no recursion.
//
// All calls come from one context. The image of a pending table or of one in force must not change;
// is_in_use() tells whether an image is one of these. activate() copies limits and scales out of
// the image, so that a fade to zero reads no image.
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

// Inputs of one cycle. Targets are in the drives' increments (CiA 402 0x607A).
struct CycleInput {
  std::array<std::int32_t, kMaxJoints> target = {};
  std::array<std::int32_t, kMaxSensors> temperature_mdegc = {};  // 0.001 °C, in the table's order
  std::uint32_t temperature_valid = 0;  // bit s: sensor s is valid; if clear, its reference is used
  std::int32_t payload_g = 0;           // mass at the tool point, gram
  std::uint64_t time_ms = 0;            // since the device started; taken as the arm's start
  // Time since the previous cycle. Values above the control period count as one period, so that a
  // pause does not permit a larger step.
  std::uint32_t elapsed_us = UINT32_MAX;
  // Bit k: joint k gets no output in this cycle, and its correction does not change.
  std::uint8_t held = 0;
};

// Range and limits of a joint's positions, in increments. Positions wrap around if the range
// (0x607B) is narrower than 32 bits; the limits are the drive's (0x607D).
struct PositionBounds {
  std::int32_t range_low = INT32_MIN;
  std::int32_t range_high = INT32_MAX;
  std::int32_t limit_low = INT32_MIN;
  std::int32_t limit_high = INT32_MAX;

  bool wraps() const {
    return range_low < range_high && (range_low != INT32_MIN || range_high != INT32_MAX);
  }
  // `position` wrapped into the range, as the drive counts it.
  std::int32_t wrapped(std::int64_t position) const;
  // `way` is the difference of two positions; where positions wrap, the shortest one is returned.
  std::int64_t way(std::int64_t way) const;
  // `corrected` clamped to the limits, or to `plain` (the uncorrected target) where that lies
  // beyond them. Continuous in both arguments, so that the output does not step when `plain` itself
  // passes a limit. Call it on the result of in_force().
  std::int64_t within_limits(std::int64_t corrected, std::int32_t plain) const;
  // The bounds with limits adapted to a range in which positions wrap: the limits are narrowed to
  // the range. They are switched off (limit_low = limit_high) if they permit all of the range or
  // none of it.
  PositionBounds in_force() const;
};

// What the compensator is doing.
enum class CompensatorState : std::uint8_t {
  kPassThrough = 0,  // no table active: delta is zero, output equals input exactly
  kBlending = 1,     // changing to an active table, to another one, or to none
  kActive = 2,
};

// What happened in one cycle, combined with bitwise or.
enum CycleFlags : std::uint16_t {
  kCycleClean = 0,
  kMagnitudeClamped = 1U << 0,  // a joint exceeded its largest correction: all were scaled
  kRateClamped = 1U << 1,       // a correction's rate of change was limited
  kNearSingular = 1U << 2,      // damping above 1 % in some direction, or a step was scaled
  kOutsideCoverage = 1U << 3,   // a table, grid or spline was evaluated outside its data
  kStateSaturated = 1U << 4,    // an input was outside the range that the format can hold
  kOutputSaturated = 1U << 5,   // target plus correction left the 32-bit range
  kAtPositionLimit = 1U << 6,   // a corrected target was clamped to a software limit
};

// Number of cycles with each event since construction. Counters stop at their maximum.
struct CycleCounters {
  std::uint32_t cycles = 0;
  std::uint32_t magnitude_clamped = 0;
  std::uint32_t rate_clamped = 0;
  std::uint32_t output_saturated = 0;
  // Per joint: cycles in which one of its own limits acted (magnitude, rate, position, 32-bit
  // range). A correction beyond one joint's magnitude scales all joints, but is counted for that
  // joint only.
  std::array<std::uint32_t, kMaxJoints> clamped = {};
};

struct CycleOutput {
  std::array<std::int32_t, kMaxJoints> corrected = {};  // sent to the drives, increments
  std::array<std::int32_t, kMaxJoints> delta = {};      // corrected - target, increments
  std::uint32_t cycle = 0;                              // pass it to correction_of()
  std::uint16_t flags = kCycleClean;
  CompensatorState state = CompensatorState::kPassThrough;
};

// What the device is set up for; fixed while it runs.
struct CompensatorConfig {
  std::uint8_t joint_count = 6;
  std::uint32_t cycle_us = 1000;  // control period; rate limits and blend time refer to it
};

// Scales and limits of a joint's drive: fields of its record in the table and per-cycle values
// derived from them.
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
  // Largest correction, and its largest change in a control period, in increments: the smaller of
  // the results of the two scales.
  std::int32_t magnitude_increments = 0;
  std::int32_t rate_increments = 0;
  // Increments per turn or metre; at most INT32_MAX.
  std::int32_t per_turn = 0;

  // Converts a difference of two positions, |increments| < 2^32, to units of 2^-32 turn (metre).
  // The product fits 64 bits with room for rounding, because an increment is at least two units.
  std::int64_t units_of(std::int64_t increments) const;
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
  // Approach directions stay, because they follow the dead bands of the last table while none is in
  // force. A joint whose dead band becomes larger, as with the first table, loses its direction: a
  // motion that decided it may have been smaller than the new dead band.
  bool activate();

  // Pass-through: the next cycles blend the correction out. No image is read any more.
  void disable();

  // True while cycles read from `image` or activate() would put it in force.
  bool is_in_use(std::span<const std::uint8_t> image) const;

  // One control cycle. Constant work for a given table; bounded by tests/firmware/budget.
  CycleOutput cycle(const CycleInput& input);

  // The correction of `joint` in cycle `cycle`, increments. Subtracted from the drive's actual
  // position (0x6064), it shows the controller the arm that it commanded. 0 if the cycle is more
  // than kFeedbackHistory cycles old or has not run yet.
  std::int32_t correction_of(std::uint32_t cycle, std::size_t joint) const;

  // Number of the cycle that cycle() computes next.
  std::uint32_t next_cycle() const { return cycle_; }

  // Undoes the last cycle, whose output is not sent: the state is as if it had not run, except for
  // the counters of its events. Requests made since (another table, disable(), park() and the
  // others here) stay in effect. At most once per cycle.
  void take_back();

  // Undoes the last cycle for the joints that its output did not reach (bit k: joint k). Each keeps
  // its previous correction, from which the next cycle continues at the permitted rate. The other
  // joints are not affected.
  void take_back_of(std::uint8_t joints);

  // The drive of `joint` did not receive the outputs of the last `cycles` cycles: its correction
  // continues from the one before them, at most kFeedbackHistory - 1 cycles back.
  void take_back_cycles(std::size_t joint, std::uint32_t cycles);

  // The stream of commands was interrupted. A joint keeps its approach direction if its next target
  // lies within the dead band of its last one; otherwise the direction becomes unknown.
  void restart_stream();
  // The joint was moved by something other than its targets: its approach direction is unknown.
  void forget_direction(std::size_t joint);

  // Starts the correction at `held`, the increments by which the drives stand beyond their targets,
  // clamped to the table's limits. From there it blends to that of the table in force, or to zero
  // while disabled. Approach directions become unknown. Returns false if an element of `held` was
  // beyond a limit. Ends park(). Before the first table the drives' scale is unknown, and the
  // correction starts at zero. Call it before the first cycle, and whenever the drives may hold
  // something other than the last cycle's output.
  bool begin(std::span<const std::int32_t> held);
  // Discards a begin() of which nothing has reached the drives: passes through until begin().
  void forget();

  // From the next cycle on the correction fades to zero at the permitted rate, until begin() or
  // resume(). It reaches zero within kFadeCycles, however low the table's rate is.
  void park();
  // Ends park(): blends from the present correction.
  void resume();
  static constexpr std::uint32_t kFadeCycles = 2000;

  // True while the correction fades to zero: parked, disabled or no table any more.
  bool is_fading() const {
    return motion_.state == CompensatorState::kBlending && (parked_ || !has_active_);
  }

  void set_bounds(std::size_t joint, const PositionBounds& bounds) {
    bounds_[joint] = bounds.in_force();
  }
  const PositionBounds& bounds(std::size_t joint) const { return bounds_[joint]; }
  // Bit k: joint k has no drive, according to the table in force or, without one, the last that
  // was. Before the first table every joint counts as one with a drive.
  std::uint8_t passive() const { return table_.passive(); }
  // Whether a table was ever in force.
  bool has_had_table() const { return blend_ms_ != 0; }
  // Of the table in force or, without one, the last that was.
  const JointScale& scale(std::size_t joint) const { return scale_[joint]; }

  // Inputs that the table in force reads. Bit s: the temperature of sensor s; bit kMaxSensors: the
  // payload.
  std::uint32_t needed_inputs() const { return has_active_ ? needed_inputs_ : 0; }

  CompensatorState state() const { return motion_.state; }
  std::uint32_t cycle_us() const { return config_.cycle_us; }
  const CycleCounters& counters() const { return counters_; }

 private:
  // State that one cycle passes on to the next.
  struct Motion {
    CompensatorState state = CompensatorState::kPassThrough;
    std::uint32_t blend_weight = 0;  // of the new correction in the running blend, Q30
    // Bit k: joint k has had a target since the last interruption, and its anchor is valid.
    std::uint8_t anchored = 0;
    std::array<std::int32_t, kMaxJoints> direction_anchor = {};
    std::array<std::int8_t, kMaxJoints> direction = {};    // -1, 0, +1: sign of the joint's motion
    std::array<std::int32_t, kMaxJoints> delta = {};       // last output, 2^-32 turn or metre
    std::array<std::int32_t, kMaxJoints> increments = {};  // the same in increments
    std::array<std::int32_t, kMaxJoints> delta_held = {};  // `delta` when the running blend began

    bool is_zero() const {
      constexpr std::array<std::int32_t, kMaxJoints> kNone = {};
      return delta == kNone && increments == kNone;
    }
  };

  // Applies a change between two cycles to both the present state and the one that take_back()
  // restores. Only cycle() and its undoing change one of them alone.
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
  bool parked_ = false;                    // corrections fade to zero and stay there
  // Of the table in force or, without one, the last that was.
  std::array<JointScale, kMaxJoints> scale_ = {};
  JointAmounts magnitude_ = {};  // largest correction
  std::array<PositionBounds, kMaxJoints> bounds_ = {};
  std::uint16_t blend_ms_ = 0;
  std::uint32_t blend_step_ = 0;  // increase of the blend's weight per control period
  std::uint32_t needed_inputs_ = 0;
  std::uint32_t cycle_ = 0;
  Motion motion_;
  Motion before_;  // before the last cycle
  std::array<std::array<std::int32_t, kMaxJoints>, kFeedbackHistory> history_ = {};
  std::array<std::int32_t, kMaxJoints> overwritten_ = {};  // row of history_ that cycle() replaced
  CycleCounters counters_;
  Workspace workspace_;
};

}  // namespace armtrue

#endif  // ARMTRUE_FIRMWARE_CORE_COMPENSATOR_H_
