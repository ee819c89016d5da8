#include "firmware/canopen/motion/joint_path.h"

#include <algorithm>
#include <bit>
#include <cstring>
#include <span>

#include "firmware/canopen/protocol/search.h"
#include "firmware/core/division.h"
#include "firmware/core/fixed.h"

namespace armtrue::canopen {
namespace {

void count(std::uint32_t& counter) {
  if (counter != UINT32_MAX) ++counter;
}

bool same_payload(const CanFrame& one, const CanFrame& other) {
  return one.len == other.len && std::memcmp(one.data, other.data, one.len) == 0;
}

}  // namespace

JointPath::JointPath(ObjectDictionary& dictionary, Compensator& compensator, Emcy& emcy,
                     std::uint8_t joint_count, std::uint64_t (*clock_us)())
    : dictionary_(dictionary),
      compensator_(compensator),
      emcy_(emcy),
      clock_us_(clock_us),
      joint_count_(joint_count) {}

void JointPath::configure(const PdoTable& pdos) {
  drop_set();
  expected_ = 0;
  synchronous_ = false;
  std::uint32_t joints = 0;
  for (std::size_t k = 0; k < kRpdos; ++k) {
    const Pdo& pdo = pdos.rpdo(k);
    if (!pdo.valid || !pdo.mapping.has_axis_object(kTargetPosition)) continue;
    expected_ |= 1U << k;
    synchronous_ = synchronous_ || pdo.is_synchronous();
    for (const MappedEntry& mapped : pdo.mapping.used()) {
      if (axis_object(mapped.index) == kTargetPosition) {
        joints |= 1U << axis_of(mapped.index);
      }
    }
  }
  const std::uint32_t needed = (1U << joint_count_) - 1U;
  if ((joints & needed) != needed) expected_ = 0;
}

void JointPath::drop_set() {
  present_ = 0;
  held_count_ = 0;
  evaluated_ = false;
  spoilt_ = false;
}

const JointPath::Held* JointPath::find(std::span<const Held> frames, std::size_t rpdo) {
  return first_where(frames, [rpdo](const Held& held) { return held.rpdo == rpdo; });
}

void JointPath::end_interval() {
  const std::span<const Held> held(held_.data(), held_count_);
  const std::span<const Held> previous(previous_.data(), previous_count_);
  // If all of it were repeats of the set before, nothing was lost.
  const bool only_repeats =
      !spoilt_ && first_where(held, [previous](const Held& one) {
                    const Held* before = find(previous, one.rpdo);
                    return before == nullptr || !same_payload(before->frame, one.frame);
                  }) == nullptr;
  if (present_ != 0 && !evaluated_) count(only_repeats ? counters_.repeated : counters_.withheld);
  // A frame that is missing here may come late, ahead of its successor: the next set could be
  // complete with it and would be a mixture. So what follows an interval that was not whole waits.
  // An arm that stands still repeats whole sets: those are whole, too, or it could never go on.
  const bool is_whole = present_ == expected_ && !spoilt_;
  if (present_ == 0 || is_whole || !only_repeats) trusted_ = is_whole;
  drop_set();
}

void JointPath::close_window(std::uint64_t now_us) {
  const std::uint32_t window_us = dictionary_.get(od::compensator_control::kSetWindow);
  const bool is_over = present_ != 0 && !evaluated_ && now_us - set_begin_us_ > window_us;
  // Where SYNC divides the sets a whole one that waits for trust is left for SYNC to end.
  if (is_over && (!sync_in_use_ || present_ != expected_)) end_interval();
}

bool JointPath::take_target(const Pdo& pdo, std::size_t rpdo, const CanFrame& frame,
                            CanPort* downstream, std::uint64_t now_us) {
  close_window(now_us);
  if (frame.len < pdo.mapping.length) {
    // A short target is a missing target.
    count(counters_.malformed);
    spoilt_ = true;
    clean_sets_ = 0;
    emcy_.raise(Condition::kPdoLength, frame.id);
    return false;
  }
  if (const Held* same = find({held_.data(), held_count_}, rpdo)) {
    if (same_payload(same->frame, frame)) {
      count(counters_.repeated);
      return false;
    }
    if (sync_in_use_) {
      // Two different targets for the same joints in one interval: whose are the others?
      spoilt_ = true;
      count(counters_.conflicts);
      clean_sets_ = 0;
      emcy_.raise(Condition::kTargetConflict, frame.id);
      return false;
    }
    end_interval();  // without SYNC the newer frame can only be of the next cycle
  }
  if (present_ == 0) set_begin_us_ = now_us;
  held_[held_count_++] = {frame, &pdo, static_cast<std::uint8_t>(rpdo)};
  present_ |= 1U << rpdo;
  const bool may_be_mixed = !trusted_ && !std::has_single_bit(expected_);
  if (present_ != expected_ || spoilt_ || synchronous_ || may_be_mixed) return false;
  const bool is_out = evaluate(downstream, now_us);
  if (!sync_in_use_) end_interval();
  return is_out;
}

bool JointPath::on_sync(CanPort* downstream, std::uint64_t now_us) {
  // A set that a late SYNC left waiting for longer than two intervals is old; where the interval is
  // not known yet, than the set window.
  const std::uint64_t waits_us =
      sync_period_us_ == 0 ? std::uint64_t{dictionary_.get(od::compensator_control::kSetWindow)}
                           : 2 * sync_period_us_;
  const bool on_time = now_us - set_begin_us_ <= waits_us;
  const bool fresh =
      synchronous_ && present_ == expected_ && !spoilt_ && on_time && evaluate(downstream, now_us);
  end_interval();
  if (sync_in_use_) sync_period_us_ = now_us - last_sync_us_;
  sync_in_use_ = true;
  last_sync_us_ = now_us;
  return fresh;
}

void JointPath::read_inputs(std::uint64_t now_us) {
  for (std::size_t k = 0; k < held_count_; ++k) {
    apply_rpdo(dictionary_, *held_[k].pdo, held_[k].frame);
  }
  for (std::size_t axis = 0; axis < joint_count_; ++axis) {
    input_.target[axis] = dictionary_.get(od::axis::kTargetPosition[axis]);
  }
  const std::uint64_t limit_us =
      dictionary_.get(od::compensator_control::kTemperatureTimeOut) * std::uint64_t{1000};
  input_.temperature_valid = 0;
  for (std::size_t sensor = 0; sensor < kMaxSensors; ++sensor) {
    // 0x2020 counts in 0.01 °C.
    input_.temperature_mdegc[sensor] = dictionary_.get(od::kTemperatureInputs[sensor]) * 10;
    if ((temperature_given_ >> sensor & 1U) != 0 && now_us - temperature_us_[sensor] <= limit_us) {
      input_.temperature_valid |= 1U << sensor;
    }
  }
  input_.payload_g = static_cast<std::int32_t>(dictionary_.get(od::kPayloadMass));
  input_.time_ms = milliseconds_of(now_us);
}

bool JointPath::begin(bool drives_wait, std::uint64_t now_us) {
  std::array<std::int32_t, kMaxJoints> held = {};
  known_ = heard_ + 1U == 1U << joint_count_;
  for (std::size_t axis = 0; axis < joint_count_; ++axis) {
    const std::int32_t target = input_.target[axis];
    if (target != resting_[axis]) resting_since_us_ = now_us;
    resting_[axis] = target;
    if (!known_) continue;
    const std::int64_t actual = dictionary_.get(od::axis::kPositionActualValue[axis]);
    held[axis] = saturate(actual - target);
  }
  const bool fits = compensator_.begin(held);
  begun_ = drives_wait || !known_ || (fits && now_us - resting_since_us_ >= kRestUs);
  known_ = known_ && begun_;
  return begun_;
}

void JointPath::put_out(std::uint64_t now_us) {
  const CycleOutput output = compensator_.cycle(input_);
  last_cycle_ = output.cycle;
  last_output_us_ = now_us;
  last_flags_ = output.flags;
  for (std::size_t axis = 0; axis < joint_count_; ++axis) {
    dictionary_.set(od::axis::kPositionOffset[axis], output.delta[axis]);
    dictionary_.set(od::axis::kPositionDemandValue[axis], output.corrected[axis]);
  }
}

bool JointPath::evaluate(CanPort* downstream, std::uint64_t now_us) {
  if (leaving_) return false;  // fade() has it
  const std::uint64_t begin_us = clock_us_();
  read_inputs(now_us);
  const bool is_first = !begun_;
  if (is_first && !begin(downstream != nullptr, now_us)) return false;
  put_out(now_us);
  if (is_first) first_cycle_ = last_cycle_;
  if (downstream != nullptr) release(*downstream);
  previous_ = held_;
  previous_count_ = held_count_;
  evaluated_ = true;
  count(counters_.sets);
  if (++clean_sets_ >= kCleanSets) {
    emcy_.clear(Condition::kTargetConflict);
    emcy_.clear(Condition::kPdoLength);
  }
  streaming_ = true;
  last_set_us_ = now_us;
  emcy_.clear(Condition::kJointInputStale);
  const auto took_us = static_cast<std::uint32_t>(clock_us_() - begin_us);
  counters_.worst_cycle_us = std::max(counters_.worst_cycle_us, took_us);
  return true;
}

void JointPath::release(CanPort& downstream) {
  bool refused = false;
  for (std::size_t k = 0; k < held_count_; ++k) {
    CanFrame frame = held_[k].frame;
    for (const MappedEntry& mapped : held_[k].pdo->mapping.used()) {
      if (axis_object(mapped.index) != kTargetPosition) continue;
      const std::size_t axis = axis_of(mapped.index);
      if (axis >= joint_count_) continue;
      store_le(&frame.data[mapped.at], dictionary_.get(od::axis::kPositionDemandValue[axis]));
    }
    // Once a frame was refused the rest of the set stays back too: as few joints as possible
    // differ.
    refused = refused || !downstream.send(frame);
    if (refused) count(counters_.output_refused);
  }
}

void JointPath::take_feedback(const Pdo& pdo, CanFrame& frame) {
  if (frame.len < pdo.mapping.length) {
    count(counters_.malformed);
    return;
  }
  for (const MappedEntry& mapped : pdo.mapping.used()) {
    if (axis_object(mapped.index) != kActualPosition) continue;
    const std::size_t axis = axis_of(mapped.index);
    if (axis >= joint_count_) continue;
    if (!begun_) {
      heard_ |= 1U << axis;
      continue;
    }
    std::uint8_t* place = &frame.data[mapped.at];
    const std::uint32_t delay = std::min<std::uint32_t>(
        dictionary_.get(od::compensator_control::kFeedbackDelay), last_cycle_ - first_cycle_);
    const std::int64_t actual = load_le<std::int32_t>(place);
    store_le(place, saturate(actual - compensator_.correction_of(last_cycle_ - delay, axis)));
  }
  apply_rpdo(dictionary_, pdo, frame);
}

void JointPath::interrupted() {
  streaming_ = false;
  trusted_ = false;
  compensator_.restart_stream();
}

bool JointPath::process(std::uint64_t now_us) {
  close_window(now_us);
  const std::uint32_t stale_us = dictionary_.get(od::compensator_control::kStaleTimeOut);
  const bool late = now_us - last_process_us_ > kSupervisionUs;
  const bool overlooked = streaming_ && now_us - last_set_us_ > stale_us + kSupervisionUs;
  last_process_us_ = now_us;
  // A controller without SYNC is told apart by its window alone.
  if (sync_in_use_ && now_us - last_sync_us_ > stale_us) {
    sync_in_use_ = false;
    end_interval();
  }
  if (streaming_ && now_us - last_set_us_ > stale_us) {
    count(counters_.stale);
    interrupted();
    emcy_.raise(Condition::kJointInputStale, counters_.stale);
  }
  const std::uint64_t limit_us =
      dictionary_.get(od::compensator_control::kTemperatureTimeOut) * std::uint64_t{1000};
  for (std::size_t sensor = 0; sensor < kMaxSensors; ++sensor) {
    const bool given = (temperature_given_ >> sensor & 1U) != 0;
    if (given && now_us - temperature_us_[sensor] > limit_us) {
      temperature_given_ &= ~(1U << sensor);
      emcy_.raise(Condition::kTemperatureStale, static_cast<std::uint32_t>(sensor + 1));
    }
  }
  return !late && !overlooked;
}

void JointPath::stop() {
  drop_set();
  trusted_ = false;
  if (streaming_) interrupted();
}

void JointPath::forget() {
  begun_ = false;
  known_ = false;
  leaving_ = false;
  heard_ = 0;
}

bool JointPath::leave() {
  if (!begun_) return false;
  compensator_.park();
  leaving_ = compensator_.is_fading();
  if (!leaving_) forget();
  return leaving_;
}

bool JointPath::fade(std::uint64_t now_us) {
  // A stream takes the steps itself, unless it is about to be cut off.
  const bool is_due = begun_ && (leaving_ || !streaming_) && compensator_.is_fading() &&
                      now_us - last_output_us_ >= compensator_.cycle_us();
  if (is_due) put_out(now_us);
  return is_due;
}

void JointPath::note_refused(std::uint32_t frames) {
  for (; frames != 0; --frames) count(counters_.output_refused);
}

std::uint64_t JointPath::quiet_us(std::uint64_t now_us) const {
  return seen_target_ ? now_us - last_target_us_ : UINT64_MAX;
}

void JointPath::note_temperature(std::size_t sensor, std::uint64_t now_us) {
  temperature_us_[sensor] = now_us;
  temperature_given_ |= 1U << sensor;
  emcy_.clear(Condition::kTemperatureStale);
}

}  // namespace armtrue::canopen
