#include "firmware/core/compensator.h"

#include <algorithm>
#include <memory>

#include "firmware/core/fixed/counter.h"

namespace armtrue {
namespace {

// Two positions may lie further apart than 32 bits hold.
constexpr std::int64_t difference(std::int32_t a, std::int32_t b) { return std::int64_t{a} - b; }

constexpr std::uint32_t kMicrosecondsPerMillisecond = 1000;
constexpr std::int64_t kMillion = 1'000'000;
constexpr int kBlendFraction = 30;
constexpr std::uint32_t kWhole = std::uint32_t{1} << kBlendFraction;

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

std::uint32_t inputs_of(const TableView& table) {
  const SectionView& states = table.section(format::Section::kState);
  std::uint32_t inputs = 0;
  for (std::size_t i = 0; i < states.count; ++i) {
    const std::uint8_t* state = states.begin + i * format::state::kLength;
    const auto kind = static_cast<format::State>(state[format::state::kKindAt]);
    if (kind == format::State::kTemperature) inputs |= 1U << state[format::state::kIndexAt];
    if (kind == format::State::kPayload) inputs |= 1U << kMaxSensors;
  }
  return inputs;
}

// amount · share, rounded up. `share`: part of a control period, Q30, nearly always 1.
std::int32_t share_of_amount(std::int32_t amount, std::uint32_t share) {
  if (share == kWhole) return amount;
  return static_cast<std::int32_t>(
      (product(amount, static_cast<std::int32_t>(share)) + kWhole - 1) >> kBlendFraction);
}

// `units` in increments, where an increment is mantissa / 2^shift units. 0 for mantissa 0, which is
// not a scale.
std::int32_t increments_by_unit(std::int32_t units, std::int32_t mantissa, int shift) {
  if (mantissa == 0) return 0;
  auto whole = static_cast<std::uint64_t>(units);
  for (; shift > 0 && whole < (std::uint64_t{1} << 62U); --shift) whole <<= 1U;
  std::uint64_t result = whole / static_cast<std::uint64_t>(std::abs(std::int64_t{mantissa}));
  for (; shift > 0 && result < INT32_MAX; --shift) result <<= 1U;
  return static_cast<std::int32_t>(std::min<std::uint64_t>(result, INT32_MAX));
}

// `units` in increments, where a unit is mantissa / 2^shift increments.
std::int32_t increments_by_increment(std::int32_t units, std::int32_t mantissa, int shift) {
  return saturate(std::abs(product(units, mantissa)) >> std::min(shift, 63));
}

}  // namespace

[[gnu::cold]] JointScale::JointScale(const TableView& table, std::size_t joint,
                                     std::uint32_t cycle_us) {
  const std::uint8_t* record = table.joint(joint);
  const bool slides = table.is_prismatic(joint);
  unit_per_increment = load_i32(record + format::joint::kUnitPerIncrementAt);
  increment_per_unit = load_i32(record + format::joint::kIncrementPerUnitAt);
  unit_shift = record[format::joint::kUnitShiftAt];
  increment_shift = record[format::joint::kIncrementShiftAt];
  zero = load_i32(record + format::joint::kZeroAt);
  dead_band = load_i32(record + format::joint::kDeadBandAt);
  const std::int32_t magnitude = largest_correction(table, joint);
  const std::int32_t per_second = std::min(slides ? kMaxRatePrismatic : kMaxRateRevolute,
                                           load_i32(record + format::joint::kRateAt));
  rate = saturate(product(per_second, static_cast<std::int32_t>(cycle_us)) / kMillion);
  const auto in_increments = [this](std::int32_t units) {
    return std::min(increments_by_unit(units, unit_per_increment, unit_shift),
                    increments_by_increment(units, increment_per_unit, increment_shift));
  };
  // One more, because a permitted correction may round up to the next increment.
  magnitude_increments = saturate(std::int64_t{in_increments(magnitude)} + 1);
  const std::int32_t fade = magnitude / static_cast<std::int32_t>(Compensator::kFadeCycles) + 1;
  per_turn = saturate(
      4 * std::int64_t{increments_by_unit(std::int32_t{1} << 30, unit_per_increment, unit_shift)});
  rate_increments = saturate(std::int64_t{in_increments(std::max(rate, fade))} + 2);
}

std::int64_t JointScale::units_of(std::int64_t increments) const {
  return round_shift(increments * unit_per_increment, unit_shift);
}

std::int32_t PositionBounds::wrapped(std::int64_t position) const {
  if (!wraps()) return saturate(position);
  const std::int64_t count = std::int64_t{range_high} - range_low + 1;
  // Corrections are small, so that one wrap is enough; a position further outside is not wrapped.
  if (position > range_high && position - count <= range_high) position -= count;
  if (position < range_low && position + count >= range_low) position += count;
  return saturate(position);
}

std::int64_t PositionBounds::way(std::int64_t way) const {
  if (!wraps()) return way;
  const std::int64_t count = std::int64_t{range_high} - range_low + 1;
  // A target may lie outside by any multiple of the range.
  if (way > count || way < -count) way %= count;
  if (way > count / 2) return way - count;
  return way < -count / 2 ? way + count : way;
}

std::int64_t PositionBounds::within_limits(std::int64_t corrected, std::int32_t plain) const {
  if (limit_low >= limit_high) return corrected;
  const std::int64_t low = std::min<std::int64_t>(limit_low, plain);
  const std::int64_t high = std::max<std::int64_t>(limit_high, plain);
  return std::clamp(corrected, low, high);
}

[[gnu::cold]] PositionBounds PositionBounds::in_force() const {
  PositionBounds result = *this;
  if (!wraps()) return result;
  result.limit_low = std::max(limit_low, range_low);
  result.limit_high = std::min(limit_high, range_high);
  const bool is_all = result.limit_low == range_low && result.limit_high == range_high;
  if (is_all || result.limit_low >= result.limit_high) result.limit_low = result.limit_high;
  return result;
}

[[gnu::cold]] Compensator::Compensator(const CompensatorConfig& config) : config_(config) {}

[[gnu::cold]] Validation Compensator::load(std::span<const std::uint8_t> image,
                                           const DeviceIdentity& device) {
  DeviceIdentity expected = device;
  expected.joint_count = config_.joint_count;
  const Validation validation = validate(image, expected);
  if (validation.accepted()) {
    pending_ = image;
  }
  return validation;
}

[[gnu::cold]] bool Compensator::activate() {
  if (pending_.empty()) return false;
  // Made in place: a copy would take half a kilobyte of stack.
  const TableView& table = *std::construct_at(&table_, pending_);
  pending_ = {};
  has_active_ = true;
  for (std::size_t k = 0; k < config_.joint_count; ++k) {
    const bool counted_down = scale_[k].counts_down();
    const std::int32_t dead_band = scale_[k].dead_band;
    scale_[k] = JointScale(table, k, config_.cycle_us);
    if (scale_[k].dead_band > dead_band) forget_direction(k);
    if (scale_[k].counts_down() != counted_down) {
      // The drive holds increments: these stay, and the joint's own values change their sign.
      change([k](Motion& motion) {
        motion.direction[k] = static_cast<std::int8_t>(-motion.direction[k]);
        motion.delta[k] = -motion.delta[k];
      });
    }
    magnitude_[k] = largest_correction(table, k);
  }
  blend_ms_ = std::max(table.blend_ms(), kMinBlendMilliseconds);
  needed_inputs_ = inputs_of(table);
  redirect(0);
  return true;
}

[[gnu::cold]] void Compensator::disable() {
  has_active_ = false;
  pending_ = {};
  redirect(0);
}

[[gnu::cold]] bool Compensator::is_in_use(std::span<const std::uint8_t> image) const {
  return (!pending_.empty() && pending_.data() == image.data()) ||
         (has_active_ && table_.image().data() == image.data());
}

// Starts a new blend, from the present correction to that of the table in force, or to zero. If
// `blend_weight` is kWhole, nothing is blended and only the rate limit slows the change.
[[gnu::cold]] void Compensator::redirect(std::uint32_t blend_weight) {
  const std::uint32_t cycles = blend_ms_ * kMicrosecondsPerMillisecond / config_.cycle_us + 1U;
  blend_step_ = kWhole / cycles;
  change([this, blend_weight](Motion& motion) {
    motion.blend_weight = blend_weight;
    motion.delta_held = motion.delta;
    // A correction of zero needs no blending out, and there may be no limits yet to apply to it.
    const bool is_there = !corrects() && motion.is_zero();
    motion.state = is_there ? CompensatorState::kPassThrough : CompensatorState::kBlending;
  });
}

[[gnu::cold]] bool Compensator::begin(std::span<const std::int32_t> held) {
  parked_ = false;
  change([](Motion& motion) {
    motion.anchored = 0;
    motion.direction = {};
  });
  if (!has_had_table()) return true;  // and no scale
  bool fits = true;
  for (std::size_t k = 0; k < config_.joint_count; ++k) {
    const std::int64_t exact = scale_[k].units_of(held[k]);
    motion_.delta[k] =
        static_cast<std::int32_t>(std::clamp<std::int64_t>(exact, -magnitude_[k], magnitude_[k]));
    motion_.increments[k] = increments_of(k);
    // The row before the first cycle, which take_back_of() reads.
    history_[(cycle_ - 1) % kFeedbackHistory][k] = motion_.increments[k];
    fits = fits && motion_.delta[k] == exact;
  }
  before_ = motion_;
  redirect(0);
  return fits;
}

[[gnu::cold]] void Compensator::forget() {
  parked_ = true;
  change([](Motion& motion) { motion.delta = motion.increments = {}; });
  redirect(0);
}

[[gnu::cold]] void Compensator::park() {
  if (parked_) return;
  parked_ = true;
  redirect(kWhole);
}

[[gnu::cold]] void Compensator::resume() {
  if (!parked_) return;
  parked_ = false;
  redirect(0);
}

void Compensator::update_direction(const CycleInput& input) {
  for (std::size_t k = 0; k < config_.joint_count; ++k) {
    std::int64_t moved = bounds_[k].way(difference(input.target[k], motion_.direction_anchor[k]));
    if (scale_[k].counts_down()) moved = -moved;
    const std::int32_t band = scale_[k].dead_band;
    if ((motion_.anchored >> k & 1U) == 0) {
      const bool is_elsewhere = std::abs(moved) > band;
      if (is_elsewhere) motion_.direction[k] = 0;
      if (motion_.direction[k] == 0) motion_.direction_anchor[k] = input.target[k];
      continue;
    }
    // The anchor is the furthest point in the present direction, or the first target while the
    // direction is unknown. A reversal counts once the target has come back from it by more than
    // the dead band.
    std::int8_t& direction = motion_.direction[k];
    if (moved > band) {
      direction = 1;
    } else if (moved < -std::int64_t{band}) {
      direction = -1;
    }
    const bool leads = (direction >= 0 && moved > 0) || (direction <= 0 && moved < 0);
    if (direction != 0 && leads) motion_.direction_anchor[k] = input.target[k];
  }
  motion_.anchored = UINT8_MAX;
}

Correction Compensator::evaluate(const CycleInput& input, std::uint16_t& flags) {
  const TableView& table = table_;
  JointPositions target;
  for (std::size_t k = 0; k < config_.joint_count; ++k) {
    const JointScale& scale = scale_[k];
    // A joint without a drive counts as at zero, whatever target its axis receives.
    target[k] = {};
    if (table.is_passive(k)) continue;
    target[k] = {scale.units_of(difference(input.target[k], scale.zero))};
  }
  const Correction wanted =
      solve(table, target, surroundings_of(table, input, motion_.direction), workspace_);
  flags |= wanted.is_near_singular ? kNearSingular : kCycleClean;
  flags |= wanted.is_outside_coverage ? kOutsideCoverage : kCycleClean;
  flags |= wanted.is_saturated ? kStateSaturated : kCycleClean;
  return wanted;
}

// Time since the previous cycle as a part of the control period, Q30, at most 1.
std::uint32_t Compensator::share_of(std::uint32_t elapsed_us) const {
  if (elapsed_us >= config_.cycle_us) return kWhole;
  return static_cast<std::uint32_t>((std::uint64_t{elapsed_us} << kBlendFraction) /
                                    config_.cycle_us);
}

// The joint's next correction: `aim`, which lies within its largest correction, or as near to it as
// the rate permits.
std::int32_t Compensator::limited(std::size_t joint, std::int32_t aim, std::uint32_t share,
                                  std::uint16_t& flags) const {
  std::int32_t per_cycle = scale_[joint].rate;
  if (!corrects()) {
    const std::int32_t all_of_it = std::abs(motion_.delta_held[joint]);
    per_cycle = std::max(per_cycle, all_of_it / static_cast<std::int32_t>(kFadeCycles) + 1);
  }
  const std::int32_t most = share_of_amount(per_cycle, share);
  const std::int64_t change = std::int64_t{aim} - motion_.delta[joint];
  if (change <= most && change >= -std::int64_t{most}) return aim;
  flags |= kRateClamped;
  return motion_.delta[joint] + (change > 0 ? most : -most);
}

// Replaces `aim`, the correction at the end of the blend, by the present one: a weighted mean of
// `aim` and the correction at the start of the blend. The weight of `aim` grows with time.
void Compensator::blend(JointAmounts& aim) const {
  for (std::size_t k = 0; k < config_.joint_count; ++k) {
    const std::int32_t way = saturate(std::int64_t{aim[k]} - motion_.delta_held[k]);
    aim[k] = motion_.delta_held[k] +
             multiply<kBlendFraction>(way, static_cast<std::int32_t>(motion_.blend_weight));
  }
}

// Moves every correction towards `aim`. Returns a bit for each joint that a limit held back.
std::uint32_t Compensator::move_corrections(JointAmounts& aim, std::uint32_t share,
                                            std::uint8_t held, std::uint16_t& flags) {
  if (motion_.state == CompensatorState::kPassThrough) return 0;
  const bool blending = motion_.state == CompensatorState::kBlending;
  const auto step =
      static_cast<std::uint32_t>(share_of_amount(static_cast<std::int32_t>(blend_step_), share));
  bool settled = !blending || motion_.blend_weight >= kWhole - step;
  if (blending) motion_.blend_weight = settled ? kWhole : motion_.blend_weight + step;
  if (!settled) blend(aim);
  // After the blend, because the correction at its start may exceed the limits of a newer table.
  std::uint32_t clamped = scale_into_limits(magnitude_, config_.joint_count, aim);
  if (clamped != 0U) flags |= kMagnitudeClamped;
  clamped &= ~std::uint32_t{held};
  for (std::size_t k = 0; k < config_.joint_count; ++k) {
    if ((held >> k & 1U) != 0) {
      settled = settled && motion_.delta[k] == aim[k];
      continue;
    }
    std::uint16_t own = kCycleClean;
    motion_.delta[k] = limited(k, aim[k], share, own);
    clamped |= own != kCycleClean ? 1U << k : 0U;
    flags |= own;
    settled = settled && (corrects() || motion_.delta[k] == 0);
  }
  if (settled) {
    motion_.state = corrects() ? CompensatorState::kActive : CompensatorState::kPassThrough;
  }
  return clamped;
}

// Last check before a target or an offset is sent: clamps magnitude and rate in drive increments,
// by limits that were copied out of the image and that it can no longer change. It holds whatever
// went wrong before.
std::int32_t Compensator::within_last_limits(std::size_t joint, std::int32_t increments,
                                             std::uint32_t share) const {
  const JointScale& scale = scale_[joint];
  const std::int32_t most = share_of_amount(scale.rate_increments, share);
  const std::int32_t last = motion_.increments[joint];
  const std::int32_t near =
      std::clamp(increments, -scale.magnitude_increments, scale.magnitude_increments);
  const std::int64_t way = std::int64_t{near} - last;
  if (way > most) return last + most;
  return way < -std::int64_t{most} ? last - most : near;
}

void Compensator::put_out(const CycleInput& input, std::uint32_t share, std::uint32_t clamped,
                          CycleOutput& output) {
  for (std::size_t k = 0; k < config_.joint_count; ++k) {
    const std::int32_t wanted = motion_.delta[k] == 0 ? 0 : increments_of(k);
    const std::int32_t whole = within_last_limits(k, wanted, share);
    if (whole != wanted) {
      output.flags |= kRateClamped;
      clamped |= 1U << k;
    }
    motion_.increments[k] = whole;
    const PositionBounds& bounds = bounds_[k];
    const std::int64_t sum = std::int64_t{input.target[k]} + whole;
    const std::int64_t in_range = bounds.wraps() ? sum : saturate(sum);
    const std::int64_t allowed = bounds.within_limits(in_range, input.target[k]);
    output.corrected[k] = whole == 0 ? input.target[k] : bounds.wrapped(allowed);
    output.flags |= in_range != sum ? kOutputSaturated : kCycleClean;
    output.flags |= allowed != in_range ? kAtPositionLimit : kCycleClean;
    if (allowed != sum) clamped |= 1U << k;
    output.delta[k] =
        static_cast<std::int32_t>(bounds.way(difference(output.corrected[k], input.target[k])));
    if ((clamped >> k & 1U) != 0U) count(counters_.clamped[k]);
  }
}

CycleOutput Compensator::cycle(const CycleInput& input) {
  before_ = motion_;
  update_direction(input);
  const std::uint32_t share = share_of(input.elapsed_us);
  CycleOutput output;
  Correction wanted;
  if (corrects()) wanted = evaluate(input, output.flags);
  const std::uint32_t clamped = move_corrections(wanted.delta, share, input.held, output.flags);
  put_out(input, share, clamped, output);
  overwritten_ = history_[cycle_ % kFeedbackHistory];
  history_[cycle_ % kFeedbackHistory] = output.delta;
  output.cycle = cycle_;
  output.state = motion_.state;
  ++cycle_;
  count_cycle(output.flags);
  return output;
}

void Compensator::take_back() {
  motion_ = before_;
  --cycle_;
  history_[cycle_ % kFeedbackHistory] = overwritten_;
  if (counters_.cycles != UINT32_MAX) --counters_.cycles;
}

void Compensator::take_back_of(std::uint8_t joints) {
  auto& newest = history_[(cycle_ - 1) % kFeedbackHistory];
  const auto& before = history_[(cycle_ - 2) % kFeedbackHistory];
  for (std::size_t k = 0; k < config_.joint_count; ++k) {
    if ((joints >> k & 1U) == 0) continue;
    motion_.delta[k] = before_.delta[k];
    motion_.increments[k] = before_.increments[k];
    newest[k] = before[k];
    // Pass-through is reached only when every joint is at zero.
    const bool passes = motion_.state == CompensatorState::kPassThrough;
    if (passes && !motion_.is_zero()) motion_.state = CompensatorState::kBlending;
  }
}

[[gnu::cold]] void Compensator::take_back_cycles(std::size_t joint, std::uint32_t cycles) {
  if (blend_ms_ == 0) return;  // no table yet, and no scale
  const auto known = static_cast<std::uint32_t>(kFeedbackHistory - 1);
  const std::uint32_t count = std::min(cycles, known);
  const std::uint32_t oldest = cycle_ - count;
  const std::int32_t held = history_[(oldest - 1) % kFeedbackHistory][joint];
  for (std::uint32_t cycle = oldest; cycle != cycle_; ++cycle) {
    history_[cycle % kFeedbackHistory][joint] = held;
  }
  change([&](Motion& motion) {
    motion.increments[joint] = held;
    motion.delta[joint] = saturate(scale_[joint].units_of(held));
    const bool passes = motion.state == CompensatorState::kPassThrough;
    if (passes && held != 0) motion.state = CompensatorState::kBlending;
  });
}

std::int32_t Compensator::increments_of(std::size_t joint) const {
  const JointScale& scale = scale_[joint];
  return saturate(
      round_shift(product(motion_.delta[joint], scale.increment_per_unit), scale.increment_shift));
}

std::int32_t Compensator::correction_of(std::uint32_t cycle, std::size_t joint) const {
  const std::uint32_t age = cycle_ - cycle;  // 1 for the newest cycle
  const bool is_known = age >= 1U && age <= kFeedbackHistory && age <= counters_.cycles;
  return is_known ? history_[cycle % kFeedbackHistory][joint] : 0;
}

void Compensator::restart_stream() {
  change([](Motion& motion) { motion.anchored = 0; });
}

void Compensator::forget_direction(std::size_t joint) {
  change([joint](Motion& motion) {
    motion.direction[joint] = 0;
    motion.anchored = static_cast<std::uint8_t>(motion.anchored & ~(1U << joint));
  });
}

void Compensator::count_cycle(std::uint16_t flags) {
  count(counters_.cycles);
  const auto count_if = [flags](CycleFlags flag, std::uint32_t& counter) {
    if ((flags & flag) != 0U) count(counter);
  };
  count_if(kMagnitudeClamped, counters_.magnitude_clamped);
  count_if(kRateClamped, counters_.rate_clamped);
  count_if(kOutputSaturated, counters_.output_saturated);
}

}  // namespace armtrue
