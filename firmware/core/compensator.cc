#include "firmware/core/compensator.h"

#include <limits>
#include <memory>

#include "firmware/core/division.h"

namespace armtrue {
namespace {

constexpr std::uint32_t kMicrosecondsPerMillisecond = 1000;
constexpr int kBlendFraction = 30;
constexpr std::uint32_t kBlendEnd = std::uint32_t{1} << kBlendFraction;

std::int64_t units_of(const std::uint8_t* joint, std::int32_t increments) {
  const int shift = joint[format::joint::kUnitShiftAt];
  return round_shift(product(increments, load_i32(joint + format::joint::kUnitPerIncrementAt)),
                     shift);
}

JointPosition position_of(const std::uint8_t* joint, std::int32_t increments) {
  return {units_of(joint, saturate(static_cast<std::int64_t>(increments) -
                                   load_i32(joint + format::joint::kZeroAt)))};
}

void count_one(std::uint32_t& counter) {
  counter += counter < std::numeric_limits<std::uint32_t>::max() ? 1U : 0U;
}

Surroundings surroundings_of(const TableView& table, const CycleInput& input,
                             const std::array<std::int8_t, kMaxJoints>& direction) {
  Surroundings result;
  const std::uint8_t* sensors = table.section(format::Section::kSensors).begin;
  for (std::size_t s = 0; s < table.sensor_count(); ++s) {
    const std::int32_t reference =
        load_i32(sensors + s * format::sensor::kLength + format::sensor::kReferenceAt);
    const bool is_known = ((input.temperature_valid >> s) & 1U) != 0U;
    result.temperature_difference[s] =
        is_known ? temperature_difference(input.temperature_mdegc[s], reference) : 0;
  }
  result.payload = payload_of_grams(input.payload_g);
  result.time = time_of_milliseconds(input.time_ms);
  result.direction = direction;
  return result;
}

constexpr std::int32_t smaller(std::int32_t a, std::int32_t b) { return a < b ? a : b; }

// Largest change of a correction in one cycle, 2^-32 turn or metre.
std::int32_t rate_per_cycle(const TableView& table, std::size_t joint, std::uint32_t cycle_us) {
  const std::int32_t per_second =
      smaller(table.is_prismatic(joint) ? kMaxRatePrismatic : kMaxRateRevolute,
              load_i32(table.joint(joint) + format::joint::kRateAt));
  return saturate(
      static_cast<std::int64_t>(millionths(static_cast<std::uint32_t>(per_second), cycle_us)));
}

}  // namespace

std::int32_t within_magnitude(const TableView& table, std::size_t joint, std::int64_t wanted) {
  const std::int32_t largest =
      smaller(table.is_prismatic(joint) ? kMaxDeltaPrismatic : kMaxDeltaRevolute,
              load_i32(table.joint(joint) + format::joint::kMagnitudeAt));
  if (wanted > largest) {
    return largest;
  }
  return wanted < -largest ? -largest : static_cast<std::int32_t>(wanted);
}

[[gnu::cold]] Compensator::Compensator(const CompensatorConfig& config) : config_(config) {}

[[gnu::cold]] Validation Compensator::load(std::span<const std::uint8_t> image,
                                           const DeviceIdentity& device) {
  if (request_.load(std::memory_order_acquire) != Request::kNone) {
    return {Refusal::kBusy, 0};
  }
  DeviceIdentity expected = device;
  expected.joint_count = config_.joint_count;
  const Validation validation = validate(image, expected);
  if (validation.accepted()) {
    // The joint path reads only tables_[active_] until it takes the request below.
    // Made in place: a copy would take half a kilobyte of stack.
    const TableView& table = *std::construct_at(&tables_[1U - active_], image);
    for (std::size_t k = 0; k < table.joint_count(); ++k) {
      rate_per_cycle_[1U - active_][k] = rate_per_cycle(table, k, config_.cycle_us);
    }
    has_pending_ = true;
  }
  return validation;
}

bool Compensator::activate() {
  if (!has_pending_) {
    return false;
  }
  has_pending_ = false;
  request_.store(Request::kActivate, std::memory_order_release);
  return true;
}

void Compensator::disable() { request_.store(Request::kDisable, std::memory_order_release); }

[[gnu::cold]] bool Compensator::is_in_use(std::span<const std::uint8_t> image) const {
  const bool is_requested = request_.load(std::memory_order_acquire) != Request::kNone;
  // A table that is being blended out still limits its own way to zero.
  const bool is_running = has_active_ || state_ != CompensatorState::kPassThrough;
  const auto holds = [image](const TableView& table) {
    return table.image().data() == image.data();
  };
  return ((has_pending_ || is_requested) && holds(tables_[1U - active_])) ||
         ((is_running || is_requested) && holds(tables_[active_]));
}

[[gnu::cold]] void Compensator::take_request() {
  const Request request = request_.load(std::memory_order_acquire);
  if (request == Request::kNone) {
    return;
  }
  if (request == Request::kDisable && state_ == CompensatorState::kPassThrough) {
    // Nothing to blend out, and perhaps no table yet whose limits could hold it.
    has_active_ = false;
    request_.store(Request::kNone, std::memory_order_release);
    return;
  }
  std::uint32_t blend_ms = kMinBlendMilliseconds;
  if (request == Request::kActivate) {
    active_ = static_cast<std::uint8_t>(1U - active_);
    has_active_ = true;
    count_one(counters_.tables_switched);
  }
  if (tables_[active_].blend_ms() > blend_ms) {
    blend_ms = tables_[active_].blend_ms();
  }
  if (request == Request::kDisable) {
    has_active_ = false;
  }
  const std::uint32_t cycles = blend_ms * kMicrosecondsPerMillisecond / config_.cycle_us + 1U;
  blend_step_ = kBlendEnd / cycles;
  hold();
  request_.store(Request::kNone, std::memory_order_release);
}

[[gnu::cold]] void Compensator::hold() {
  blend_weight_ = 0;
  delta_held_ = delta_;
  state_ = CompensatorState::kBlending;
}

[[gnu::cold]] bool Compensator::begin(std::span<const std::int32_t> held) {
  parked_ = false;
  take_request();
  if (!has_active_ && state_ == CompensatorState::kPassThrough) {
    return true;
  }
  bool fits = true;
  for (std::size_t k = 0; k < config_.joint_count; ++k) {
    const std::int64_t exact = units_of(tables_[active_].joint(k), held[k]);
    delta_[k] = within_magnitude(tables_[active_], k, exact);
    fits = fits && delta_[k] == exact;
  }
  hold();
  return fits;
}

[[gnu::cold]] void Compensator::park() {
  if (!parked_ && state_ != CompensatorState::kPassThrough) {
    state_ = CompensatorState::kBlending;
    blend_weight_ = kBlendEnd;
  }
  parked_ = true;
}

void Compensator::update_direction(const CycleInput& input) {
  for (std::size_t k = 0; k < config_.joint_count; ++k) {
    const std::int64_t moved = static_cast<std::int64_t>(input.target[k]) - direction_anchor_[k];
    const std::int32_t band =
        has_active_ ? load_i32(tables_[active_].joint(k) + format::joint::kDeadBandAt) : 0;
    if (!has_previous_target_) {
      direction_anchor_[k] = input.target[k];
      continue;
    }
    // The anchor trails the command by the dead band on the side it came from: a reversal counts
    // once the command has come back by more than the band from its furthest point.
    if (moved > band) {
      direction_[k] = 1;
    } else if (moved < -static_cast<std::int64_t>(band)) {
      direction_[k] = -1;
    }
    const bool leads = (direction_[k] >= 0 && moved > 0) || (direction_[k] <= 0 && moved < 0);
    if (direction_[k] != 0 && leads) {
      direction_anchor_[k] = input.target[k];
    }
  }
  has_previous_target_ = true;
}

std::int32_t Compensator::limited(std::size_t joint, std::int64_t wanted, std::uint16_t& flags) {
  const TableView& table = tables_[active_];
  const std::int32_t near = within_magnitude(table, joint, wanted);
  flags |= near != wanted ? kMagnitudeClamped : kCycleClean;
  const std::int64_t per_cycle = rate_per_cycle_[active_][joint];
  const std::int64_t change = static_cast<std::int64_t>(near) - delta_[joint];
  if (change > per_cycle || change < -per_cycle) {
    flags |= kRateClamped;
    return saturate(delta_[joint] + (change > 0 ? per_cycle : -per_cycle));
  }
  return near;
}

CycleOutput Compensator::cycle(const CycleInput& input) {
  take_request();
  update_direction(input);

  CycleOutput output;
  std::uint16_t flags = kCycleClean;
  Correction wanted;
  const bool corrects = has_active_ && !parked_;
  if (corrects) {
    const TableView& table = tables_[active_];
    JointPositions target;
    for (std::size_t k = 0; k < table.joint_count(); ++k) {
      target[k] = position_of(table.joint(k), input.target[k]);
    }
    wanted = solve(table, target, surroundings_of(table, input, direction_), workspace_);
    flags |= wanted.is_near_singular ? kNearSingular : kCycleClean;
    flags |= wanted.is_outside_coverage ? kOutsideCoverage : kCycleClean;
    flags |= wanted.is_saturated ? kStateSaturated : kCycleClean;
  }

  std::uint32_t clamped = 0;  // bit k: joint k
  bool settled = true;
  if (state_ == CompensatorState::kBlending) {
    settled = blend_weight_ >= kBlendEnd - blend_step_;
    blend_weight_ = settled ? kBlendEnd : blend_weight_ + blend_step_;
  }
  for (std::size_t k = 0; k < config_.joint_count; ++k) {
    std::int64_t delta = wanted.delta[k];
    if (state_ == CompensatorState::kBlending && !settled) {
      const std::int32_t way = saturate(delta - delta_held_[k]);
      delta = delta_held_[k] + static_cast<std::int64_t>(multiply<kBlendFraction>(
                                   way, static_cast<std::int32_t>(blend_weight_)));
    }
    if (state_ != CompensatorState::kPassThrough) {
      std::uint16_t own = kCycleClean;
      delta_[k] = limited(k, delta, own);
      clamped |= own != kCycleClean ? 1U << k : 0U;
      flags |= own;
      settled = settled && (corrects || delta_[k] == 0);
    }
  }
  if (state_ == CompensatorState::kBlending && settled) {
    state_ = corrects ? CompensatorState::kActive : CompensatorState::kPassThrough;
  }

  for (std::size_t k = 0; k < config_.joint_count; ++k) {
    const std::int32_t whole = delta_[k] == 0 ? 0 : increments_of(k);
    const std::int64_t sum = static_cast<std::int64_t>(input.target[k]) + whole;
    output.corrected[k] = saturate(sum);
    if (output.corrected[k] != sum) {
      flags |= kOutputSaturated;
      clamped |= 1U << k;
    }
    if ((clamped >> k & 1U) != 0U) count_one(counters_.clamped[k]);
    output.delta[k] =
        static_cast<std::int32_t>(static_cast<std::int64_t>(output.corrected[k]) - input.target[k]);
  }
  history_[cycle_ % kFeedbackHistory] = output.delta;
  output.cycle = cycle_;
  output.flags = flags;
  output.state = state_;
  ++cycle_;
  count(flags);
  return output;
}

std::int32_t Compensator::increments_of(std::size_t joint) {
  const std::uint8_t* record = tables_[active_].joint(joint);
  const int shift = record[format::joint::kIncrementShiftAt];
  const std::int64_t exact =
      product(delta_[joint], load_i32(record + format::joint::kIncrementPerUnitAt));
  if (!config_.carry_remainder) {
    return saturate(round_shift(exact, shift));
  }
  // What rounding left over, in the same 2^-shift of an increment, is added in the next cycle.
  const std::int64_t with_carry = exact + carried_[joint];
  const std::int64_t whole = round_shift(with_carry, shift);
  carried_[joint] = with_carry - whole * (std::int64_t{1} << shift);
  return saturate(whole);
}

bool Compensator::remembers(std::uint32_t cycle) const {
  const std::uint32_t age = cycle_ - cycle;  // 1 for the newest cycle
  return age >= 1U && age <= kFeedbackHistory && age <= counters_.cycles;
}

std::int32_t Compensator::correction_of(std::uint32_t cycle, std::size_t joint) const {
  return remembers(cycle) ? history_[cycle % kFeedbackHistory][joint] : 0;
}

bool Compensator::uncorrect_feedback(std::uint32_t cycle, std::span<const std::int32_t> actual,
                                     std::span<std::int32_t> plain) const {
  for (std::size_t k = 0; k < config_.joint_count; ++k) {
    plain[k] = saturate(static_cast<std::int64_t>(actual[k]) - correction_of(cycle, k));
  }
  return remembers(cycle);
}

void Compensator::restart_stream() {
  has_previous_target_ = false;
  direction_ = {};
  carried_ = {};
}

void Compensator::count(std::uint16_t flags) {
  count_one(counters_.cycles);
  const auto count_if = [flags](CycleFlags flag, std::uint32_t& counter) {
    if ((flags & flag) != 0U) {
      count_one(counter);
    }
  };
  count_if(kMagnitudeClamped, counters_.magnitude_clamped);
  count_if(kRateClamped, counters_.rate_clamped);
  count_if(kNearSingular, counters_.near_singular);
  count_if(kOutsideCoverage, counters_.outside_coverage);
  count_if(kStateSaturated, counters_.state_saturated);
  count_if(kOutputSaturated, counters_.output_saturated);
}

}  // namespace armtrue
