// The joint path: targets in, corrected targets out, once per control cycle.
//
//   Compensator compensator(config);
//   compensator.load(image, device);     // background: validates, keeps it as the pending table
//   compensator.activate();              // background: swapped in at the next cycle boundary
//   CycleOutput out = compensator.cycle(in);          // joint path, every cycle
//   compensator.uncorrect_feedback(out.cycle, actual, plain);   // joint path, when feedback comes
//
// Safe by construction: without a valid table the output is the input, bit for bit. Enabling,
// disabling and switching blend over a set time from whatever correction was last put out.
// Corrections and their rate are limited by the signed table, capped by limits.h, and every clamp
// is counted. No heap, no floating point, no recursion.
//
// Contexts: cycle() and uncorrect_feedback() belong to one context (the joint path, which may be an
// interrupt); load(), activate(), disable() to one other (the background). The two meet only in one
// atomic word. The image of an active or pending table must not be changed; is_in_use() tells.
#ifndef ARMTRUE_FIRMWARE_CORE_COMPENSATOR_H_
#define ARMTRUE_FIRMWARE_CORE_COMPENSATOR_H_

#include <array>
#include <atomic>
#include <cstdint>
#include <span>

#include "firmware/core/inverse.h"
#include "firmware/core/limits.h"
#include "firmware/core/table.h"
#include "firmware/core/table_view.h"

namespace armtrue {

// What the controller tells in one cycle. Targets in the drives' own increments (CiA 402 0x607A).
struct CycleInput {
  std::array<std::int32_t, kMaxJoints> target = {};
  std::array<std::int32_t, kMaxSensors> temperature_mdegc = {};  // 0.001 °C, in the table's order
  std::uint32_t temperature_valid =
      0;                       // bit s: sensor s is known; otherwise its reference is taken
  std::int32_t payload_g = 0;  // mass at the tool point, gram
  std::uint32_t time_ms = 0;   // since start of the arm
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
  kMagnitudeClamped = 1U << 0,  // a correction was larger than the table allows
  kRateClamped = 1U << 1,       // a correction wanted to change faster than the table allows
  kNearSingular = 1U << 2,      // the damping took more than 1 % of a step's length
  kOutsideCoverage = 1U << 3,   // some 1-D table or grid was outside what it was trained on
  kStateSaturated = 1U << 4,    // an input was outside the range that the format can hold
  kOutputSaturated = 1U << 5,   // target plus correction left the 32-bit range
};

// Cycles in which each thing happened, since construction. They stop at their maximum.
struct CycleCounters {
  std::uint32_t cycles = 0;
  std::uint32_t magnitude_clamped = 0;
  std::uint32_t rate_clamped = 0;
  std::uint32_t near_singular = 0;
  std::uint32_t outside_coverage = 0;
  std::uint32_t state_saturated = 0;
  std::uint32_t output_saturated = 0;
  std::uint32_t tables_switched = 0;
  // By joint: cycles in which its output was not what was wanted (magnitude, rate, 32-bit range).
  std::array<std::uint32_t, kMaxJoints> clamped = {};
};

struct CycleOutput {
  std::array<std::int32_t, kMaxJoints> corrected = {};  // what the drives are told, increments
  std::array<std::int32_t, kMaxJoints> delta = {};      // corrected - target, increments
  std::uint32_t cycle = 0;                              // pass it to uncorrect_feedback()
  std::uint16_t flags = kCycleClean;
  CompensatorState state = CompensatorState::kPassThrough;
};

// What the device is set up for; fixed while it runs.
struct CompensatorConfig {
  std::uint8_t joint_count = 6;
  std::uint32_t cycle_us = 1000;  // control period: rate limits and blending are times
  // Carry what rounding to increments left over into the next cycle, so that coarse drives follow
  // the correction on average. Off by default: a standing target then gives a standing output.
  bool carry_remainder = false;
};

// `wanted` (2^-32 turn or metre) within the limit that the table sets for the joint, itself capped
// by limits.h.
std::int32_t within_magnitude(const TableView& table, std::size_t joint, std::int64_t wanted);

class Compensator {
 public:
  explicit Compensator(const CompensatorConfig& config);
  Compensator(const Compensator&) = delete;
  Compensator& operator=(const Compensator&) = delete;

  // Validates `image` against `device` and the configured joint count and, if accepted, keeps it as
  // the pending table (a pending table that was not activated is replaced). The image is referred
  // to, not copied. Refused with Refusal::kBusy while an activation has not been taken up yet.
  // Background only.
  Validation load(std::span<const std::uint8_t> image, const DeviceIdentity& device);

  // Asks that the pending table be swapped in at the next cycle boundary. False if none is pending.
  bool activate();

  // Asks for pass-through from the next cycle boundary on; the correction is blended out.
  void disable();

  // Takes up what was asked for by activate() or disable() without a cycle, so that several changes
  // can follow each other while no commands arrive. Nothing is put out; the blend begins with the
  // next cycle. For the joint path's context only.
  void take_up_request() { take_request(); }

  // True while the joint path may read from `image` (active or pending).
  bool is_in_use(std::span<const std::uint8_t> image) const;

  // One control cycle. Constant work for a given table; bounded by tests/firmware/budget.
  CycleOutput cycle(const CycleInput& input);

  // Takes the correction of cycle `cycle` off the drives' actual positions (0x6064), so that the
  // controller sees the arm that it commanded. Returns false, and copies `actual` unchanged, if the
  // cycle lies further back than kFeedbackHistory or has not been yet. Spans of at least
  // joint_count elements.
  bool uncorrect_feedback(std::uint32_t cycle, std::span<const std::int32_t> actual,
                          std::span<std::int32_t> plain) const;

  // The correction of `joint` in cycle `cycle`, increments; 0 where uncorrect_feedback() knows
  // none.
  std::int32_t correction_of(std::uint32_t cycle, std::size_t joint) const;

  // Forgets the direction of approach and the carried remainder. For the joint path, after the
  // stream of commands was interrupted.
  void restart_stream();

  // The drives stand `held` increments beyond their targets: the correction begins there, within
  // the table's limits, and blends from there to the right one. False if some of it was beyond a
  // limit. Ends park(). Without a table there is no correction and nothing changes. Before the
  // first cycle, and where the drives may hold something else than the last cycle's output.
  bool begin(std::span<const std::int32_t> held);

  // From the next cycle on the correction goes to zero at the permitted rate, until begin().
  void park();

  // On the way to zero: parked, disabled or without a table any more.
  bool is_fading() const {
    return state_ == CompensatorState::kBlending && (parked_ || !has_active_);
  }

  CompensatorState state() const { return state_; }
  std::uint32_t cycle_us() const { return config_.cycle_us; }
  const CycleCounters& counters() const { return counters_; }

 private:
  // What the background asks of the joint path.
  enum class Request : std::uint8_t { kNone, kActivate, kDisable };

  void take_request();
  void hold();
  void update_direction(const CycleInput& input);
  std::int32_t limited(std::size_t joint, std::int64_t wanted, std::uint16_t& flags);
  std::int32_t increments_of(std::size_t joint);
  bool remembers(std::uint32_t cycle) const;
  void count(std::uint16_t flags);

  CompensatorConfig config_;
  std::array<TableView, 2> tables_;
  std::atomic<Request> request_ = Request::kNone;
  bool has_pending_ = false;  // load() filled tables_[1 - active_]
  bool has_active_ = false;   // joint path: tables_[active_] is evaluated
  bool parked_ = false;       // joint path: but no correction is wanted
  std::uint8_t active_ = 1;
  CompensatorState state_ = CompensatorState::kPassThrough;
  // Largest change of a correction in a cycle, of either table, 2^-32 units.
  std::array<std::array<std::int32_t, kMaxJoints>, 2> rate_per_cycle_ = {};
  std::uint32_t blend_weight_ = 0;  // of the new correction in the running blend, Q30
  std::uint32_t blend_step_ = 0;    // its growth in a cycle
  std::uint32_t cycle_ = 0;
  bool has_previous_target_ = false;
  std::array<std::int32_t, kMaxJoints> direction_anchor_ = {};
  std::array<std::int8_t, kMaxJoints> direction_ = {};
  std::array<std::int32_t, kMaxJoints> delta_ = {};       // put out in the last cycle, 2^-32 units
  std::array<std::int32_t, kMaxJoints> delta_held_ = {};  // where the running blend began
  std::array<std::int64_t, kMaxJoints> carried_ = {};     // remainder of an increment
  std::array<std::array<std::int32_t, kMaxJoints>, kFeedbackHistory> history_ = {};
  CycleCounters counters_;
  Workspace workspace_;
};

}  // namespace armtrue

#endif  // ARMTRUE_FIRMWARE_CORE_COMPENSATOR_H_
