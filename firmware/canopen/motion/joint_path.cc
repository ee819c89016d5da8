#include "firmware/canopen/motion/joint_path.h"

#include <algorithm>
#include <span>

#include "firmware/core/fixed/counter.h"
#include "firmware/core/fixed/fixed.h"

namespace armtrue::canopen {

JointPath::JointPath(ObjectDictionary& dictionary, Compensator& compensator, Emcy& emcy,
                     const CanPort& upstream, CanPort* downstream, std::uint8_t joint_count,
                     std::uint64_t (*clock_us)())
    : dictionary_(dictionary),
      compensator_(compensator),
      emcy_(emcy),
      upstream_(upstream),
      downstream_(downstream),
      clock_us_(clock_us),
      joint_count_(joint_count),
      inline_output_(downstream),
      inputs_(dictionary, emcy) {}

void JointPath::configure(const PdoTable& pdos) {
  take_back();
  take_back_unsent();
  sets_.configure(pdos);
  drives_.keep(mapped_axes(pdos.rpdos(), kStatusword), mapped_axes(pdos.rpdos(), kModeDisplay));
  const bool waits = std::ranges::any_of(pdos.tpdos(), [](const Pdo& pdo) {
    return pdo.valid && pdo.is_synchronous() && pdo.mapping.has_axis_object(kPositionOffset);
  });
  offset_output_ = waits ? OffsetOutput::kWithSync : OffsetOutput::kAtOnce;
  offset_axes_ = mapped_axes(pdos.tpdos(), kPositionOffset);
  // A set that has lost its mapping has sent what its drives hold.
  if (is_configured()) inline_output_.forget_sent();
}

std::uint32_t JointPath::axes_with_drives() const {
  return ((1U << joint_count_) - 1U) & ~std::uint32_t{compensator_.passive()};
}

bool JointPath::has_drive(std::size_t axis) const {
  return axis < joint_count_ && (axes_with_drives() >> axis & 1U) != 0;
}

bool JointPath::is_configured() const {
  const std::uint32_t needed = axes_with_drives();
  const bool has_offsets = (offset_axes_ & needed) == needed && !drives_are_downstream_;
  return sets_.has_targets_of(needed) && (mode_ != Mode::kOffset || has_offsets);
}

void JointPath::configure_bounds() {
  for (std::size_t axis = 0; axis < joint_count_; ++axis) {
    compensator_.set_bounds(
        axis, {.range_low = dictionary_.get(od::axis::kMinimumPositionRangeLimit[axis]),
               .range_high = dictionary_.get(od::axis::kMaximumPositionRangeLimit[axis]),
               .limit_low = dictionary_.get(od::axis::kMinimumPositionLimit[axis]),
               .limit_high = dictionary_.get(od::axis::kMaximumPositionLimit[axis])});
  }
}

void JointPath::set_mode(Mode mode) {
  stop();
  forget();
  mode_ = mode;
}

void JointPath::forget() {
  inline_output_.release();
  unsent_ = 0;
  phase_ = Phase::kUnknown;
  start_.forget();
}

// Undoes the correction of a computed set that waits for SYNC and will not be sent.
void JointPath::take_back() {
  if (sets_.progress() != SetProgress::kComputed) return;
  compensator_.take_back();
  // If the first set does not go out, the next one is the first.
  if (phase_ == Phase::kUnknown) compensator_.forget();
  sets_.set_progress(SetProgress::kWaiting);
}

// Undoes outputs that have not reached their drives. An offset TPDO that waits for SYNC may still
// leave; it then carries the offset that its drive already has.
void JointPath::take_back_unsent() {
  if (unsent_ == 0) return;
  compensator_.take_back_of(unsent_);
  for (std::size_t axis = 0; axis < joint_count_; ++axis) {
    if ((unsent_ >> axis & 1U) == 0) continue;
    dictionary_.set(od::axis::kPositionOffset[axis], compensator_.correction_of(last_cycle_, axis));
  }
  unsent_ = 0;
}

void JointPath::end_interval() {
  take_back();
  if (!sets_.frames().empty()) sets_pass_ = sets_.progress() == SetProgress::kOut;
  if (sets_.end_interval() == SetAssembler::Ended::kWithheld) count(counters_.withheld);
}

// A spoilt set stays in its interval and does not go out; end_interval() takes it back.
void JointPath::spoil(Condition condition, std::uint32_t information, std::uint32_t& counter) {
  count(counter);
  clean_sets_ = 0;
  emcy_.raise(condition, information);
}

bool JointPath::take_target(const Pdo& pdo, std::size_t rpdo, const CanFrame& frame,
                            std::uint64_t now_us) {
  stream_.note_taken(now_us);
  if (sets_.is_over(configured_window_us(), now_us)) end_interval();
  SetEvent event = sets_.take(pdo, rpdo, frame, now_us);
  if (event == SetEvent::kNextCycle) {
    end_interval();
    event = sets_.take(pdo, rpdo, frame, now_us);
  }
  switch (event) {
    case SetEvent::kShort:
      spoil(Condition::kPdoLength, frame.id, counters_.malformed);
      return false;
    case SetEvent::kContradicted:
      spoil(Condition::kTargetConflict, frame.id, counters_.conflicts);
      return false;
    case SetEvent::kRepeated:
      count(counters_.repeated);
      return false;
    case SetEvent::kReady:
      break;
    default:
      return false;
  }
  const std::uint64_t complete_us = clock_us_();
  if (!compute(now_us) || sets_.is_synchronous()) return false;
  const bool is_out = release(now_us);
  target_latency_.note(static_cast<std::uint32_t>(clock_us_() - complete_us));
  if (!sets_.sync_in_use()) end_interval();
  return is_out;
}

void JointPath::forward_stop(const Pdo& pdo, const CanFrame& frame) {
  // A drive may have missed a command that was sent: it was switched off, or its bus was. As long
  // as sets go out, each of them repeats the command; otherwise its repetitions pass as well.
  if (!inline_output_.forward_stop(pdo, frame, !sets_pass_)) count(counters_.output_refused);
}

bool JointPath::on_sync(std::uint64_t now_us) {
  const bool goes_out = sets_.progress() == SetProgress::kComputed &&
                        sets_.content() == SetContent::kWhole &&
                        sets_.is_on_time(configured_window_us(), now_us) && release(now_us);
  end_interval();
  sets_.note_sync(now_us);
  return goes_out;
}

void JointPath::read_targets(std::uint64_t now_us) {
  for (const SetAssembler::Held& held : sets_.frames()) {
    inputs_.take(*held.pdo, held.frame, now_us);
  }
  for (std::size_t axis = 0; axis < joint_count_; ++axis) {
    const std::int32_t target = dictionary_.get(od::axis::kTargetPosition[axis]);
    if (target != input_.target[axis] && has_drive(axis)) start_.note_moved_target(now_us);
    input_.target[axis] = target;
  }
  start_.note_evaluated_set(now_us);
}

void JointPath::read_surroundings(std::uint64_t now_us) {
  inputs_.read(input_);
  input_.time_ms = now_us / 1000;
  input_.elapsed_us =
      static_cast<std::uint32_t>(std::min<std::uint64_t>(now_us - last_step_us_, UINT32_MAX));
}

// Whether the actual positions tell what the drives hold. In offset mode, where the difference to
// the target counts as it is, the arm must have stood; inline they must be new.
bool JointPath::tells_positions(std::uint64_t now_us) const {
  const std::uint32_t axes = axes_with_drives();
  return mode_ == Mode::kOffset ? start_.has_standing(axes)
                                : (axes & ~std::uint32_t{drives_.placed(now_us)}) == 0;
}

bool JointPath::begin(std::uint64_t now_us) {
  std::array<std::int32_t, kMaxJoints> held = {};
  const bool all_heard = start_.has(axes_with_drives());
  for (std::size_t axis = 0; axis < joint_count_ && all_heard; ++axis) {
    if (!has_drive(axis)) continue;
    const std::int64_t actual = dictionary_.get(od::axis::kPositionActualValue[axis]);
    held[axis] = saturate(compensator_.bounds(axis).way(actual - input_.target[axis]));
  }
  const bool fits = compensator_.begin(held);
  const bool may_begin = (fits || mode_ == Mode::kInline) && tells_positions(now_us);
  if (all_heard && !may_begin) {
    compensator_.forget();
    return false;
  }
  began_with_heard_ = all_heard;
  return true;
}

// Corrections fade to zero when a drive stops following its targets or its zero was changed, and
// return when no such reason is left. Called once per turn, after the sets of that turn.
void JointPath::follow_drives() {
  const bool suspends = suspension() != kSuspendedNot;
  if (phase_ == Phase::kCorrecting && suspends) {
    compensator_.park();
    phase_ = Phase::kSuspended;
    count(counters_.suspended);
  } else if (phase_ == Phase::kSuspended && !suspends) {
    compensator_.resume();
    phase_ = Phase::kCorrecting;
    count(counters_.resumed);
  }
}

// Whether offsets wait for SYNC and none comes. Then no correction is computed, because it would
// run ahead of the offsets that the drives have.
bool JointPath::is_kept_from_sync() const {
  return mode_ == Mode::kOffset && offset_output_ == OffsetOutput::kWithSync &&
         !sets_.sync_in_use();
}

// Whether so few commands wait in the drives' port that the next cycle may be computed.
bool JointPath::may_compute() {
  const CanPort* port = mode_ == Mode::kInline ? downstream_ : &upstream_;
  return port == nullptr || backlog_.admits(compensator_.next_cycle(), port->commands());
}

bool JointPath::compute(std::uint64_t now_us) {
  if (phase_ == Phase::kLeaving || is_kept_from_sync()) return false;  // kLeaving: fade() does it
  if (!may_compute()) {
    is_refused_ = true;
    count(counters_.output_refused);
    return false;
  }
  const std::uint64_t begin_us = clock_us_();
  take_back_unsent();
  read_targets(now_us);
  read_surroundings(now_us);
  if (phase_ == Phase::kUnknown && !begin(now_us)) return false;
  input_.held = 0;
  output_ = compensator_.cycle(input_);
  computed_us_ = now_us;
  sets_.set_progress(SetProgress::kComputed);
  const auto took_us = static_cast<std::uint32_t>(clock_us_() - begin_us);
  counters_.worst_cycle_us = std::max(counters_.worst_cycle_us, took_us);
  return true;
}

void JointPath::publish() {
  last_cycle_ = output_.cycle;
  last_step_us_ = computed_us_;
  count(counters_.steps);
  last_flags_ = output_.flags;
  for (std::size_t axis = 0; axis < joint_count_; ++axis) {
    if ((unsent_ >> axis & 1U) != 0) continue;
    dictionary_.set(od::axis::kPositionOffset[axis], output_.delta[axis]);
    dictionary_.set(od::axis::kPositionDemandValue[axis], output_.corrected[axis]);
  }
}

bool JointPath::release(std::uint64_t now_us) {
  if (mode_ == Mode::kInline) {
    const std::span<const SetAssembler::Held> frames = sets_.frames();
    const InlineOutput::SentSet sent = inline_output_.send(frames, output_, axes_with_drives());
    for (std::size_t k = sent.frames; k < frames.size(); ++k) count(counters_.output_refused);
    is_refused_ = inline_output_.is_held_up() || sent.frames < frames.size();
    unsent_ = sent.unsent;
    if (sent.frames == 0) {
      unsent_ = 0;
      take_back();
      return false;
    }
  }
  publish();
  if (mode_ == Mode::kInline) take_back_unsent();
  if (phase_ == Phase::kUnknown) {
    first_cycle_ = last_cycle_;
    phase_ = Phase::kCorrecting;
  }
  sets_.set_progress(SetProgress::kOut);
  sets_pass_ = true;
  is_offset_set_ = mode_ == Mode::kOffset;
  if (!is_offset_set_ && !is_refused_) note_set_out(now_us);
  return true;
}

// The whole set has left, or its offsets wait for SYNC.
void JointPath::note_set_out(std::uint64_t now_us) {
  count(counters_.sets);
  if (++clean_sets_ >= kCleanSets) {
    emcy_.clear(Condition::kTargetConflict);
    emcy_.clear(Condition::kPdoLength);
  }
  stream_.note_set_out(now_us);
  emcy_.clear(Condition::kJointInputStale);
  emcy_.clear(Condition::kSetsWithheld);
}

void JointPath::hear(const Pdo& pdo, const CanFrame& frame) {
  if (frame.len < pdo.mapping.length) return;
  for (const MappedEntry& mapped : pdo.mapping.used()) {
    const std::uint8_t* place = &frame.data[mapped.at];
    if (mapped.index == od::kOffsetReadBack[0].index && mapped.sub > 0) {
      check_offset(mapped.sub - 1U, load_le<std::int32_t>(place));
    }
    const std::size_t axis = axis_of(mapped.index);
    const std::uint16_t object = axis_object(mapped.index);
    // Also of a passive axis: if its drive is enabled, what needs disabled drives is refused.
    const bool is_state = object == kStatusword && axis < joint_count_;
    if (is_state) drives_.hear_state(axis, load_le<std::uint16_t>(place));
    if (!has_drive(axis)) continue;
    if (object == kModeDisplay) drives_.hear_mode(axis, static_cast<std::int8_t>(*place));
  }
}

// Compares an offset read back from a drive with those sent lately: it may be a few cycles old.
void JointPath::check_offset(std::size_t axis, std::int32_t offset) {
  if (!has_drive(axis) || mode_ != Mode::kOffset || phase_ == Phase::kUnknown) return;
  bool is_ours = false;
  for (std::uint32_t age = 0; age < kFeedbackHistory && !is_ours; ++age) {
    is_ours = offset == compensator_.correction_of(last_cycle_ - age, axis);
  }
  strange_offsets_[axis] = is_ours ? 0 : strange_offsets_[axis] + 1;
  if (is_ours) return emcy_.clear(Condition::kOffsetDiffers, axis);
  if (strange_offsets_[axis] < kStrangeOffsets) return;
  strange_offsets_[axis] = kStrangeOffsets;
  emcy_.raise(Condition::kOffsetDiffers, static_cast<std::uint32_t>(axis + 1), axis);
}

void JointPath::take_feedback(const Pdo& pdo, CanFrame& frame, std::uint64_t now_us) {
  const bool at_rest = start_.is_at_rest(now_us);
  for (const MappedEntry& mapped : pdo.mapping.used()) {
    if (axis_object(mapped.index) != kActualPosition) continue;
    const std::size_t axis = axis_of(mapped.index);
    if (!has_drive(axis)) continue;
    std::uint8_t* place = &frame.data[mapped.at];
    const auto actual = load_le<std::int32_t>(place);
    const PositionBounds& bounds = compensator_.bounds(axis);
    const auto per_turn = static_cast<std::uint32_t>(compensator_.scale(axis).per_turn);
    if (drives_.hear_position(axis, actual, at_rest, per_turn, bounds, now_us)) {
      if (changed_reference_ == 0) changed_reference_ = static_cast<std::uint8_t>(axis + 1);
      count(counters_.reference_changes);
    }
    // The joint was moved without targets: its direction of approach is no longer known.
    if (!stream_.is_streaming() &&
        drives_.has_left(axis, compensator_.scale(axis).dead_band, bounds)) {
      compensator_.forget_direction(axis);
    }
    if (phase_ == Phase::kUnknown) {
      start_.note_position(axis, now_us);
      continue;
    }
    // If its newest offset has not left, a drive still holds that of the cycle before.
    const std::uint32_t late = std::max<std::uint32_t>(
        dictionary_.get(od::compensator_control::kFeedbackDelay), unsent_ >> axis & 1U);
    const std::uint32_t delay = std::min(late, last_cycle_ - first_cycle_);
    const std::int32_t correction = compensator_.correction_of(last_cycle_ - delay, axis);
    store_le(place, correction == 0 ? actual : bounds.wrapped(std::int64_t{actual} - correction));
  }
  inputs_.take(pdo, frame, now_us);
}

std::uint8_t JointPath::suspension() const {
  std::uint8_t bits = kSuspendedNot;
  if (axes_away() != 0) bits |= kSuspendedAxisAway;
  if (changed_reference_ != 0) bits |= kSuspendedReference;
  return bits;
}

void JointPath::accept_reference() {
  changed_reference_ = 0;
  emcy_.clear(Condition::kReferenceChanged);
}

void JointPath::interrupted() {
  stream_.interrupt();
  sets_pass_ = false;
  sets_.interrupt();
  compensator_.restart_stream();
  drives_.note_stand();
}

std::uint32_t JointPath::why_withheld(std::uint64_t now_us) const {
  if (!stream_.takes_targets()) return kNotOperational;
  if (is_kept_from_sync() || (sets_.is_synchronous() && !sets_.sync_in_use())) return kSyncMissing;
  if (is_refused_) return kOutputRefused;
  if (clean_sets_ == 0 && (counters_.conflicts != 0 || counters_.malformed != 0)) {
    return kContradictions;
  }
  const bool waits_for_positions =
      phase_ == Phase::kUnknown &&
      (mode_ == Mode::kOffset || (start_.has(axes_with_drives()) && !tells_positions(now_us)));
  return waits_for_positions ? kPositionUnknown : kFramesMissing;
}

void JointPath::watch_stream(std::uint64_t now_us) {
  if (sets_.is_over(configured_window_us(), now_us)) end_interval();
  // Without SYNC the set window alone separates the sets.
  if (sets_.sync_in_use() && now_us - sets_.last_sync_us() > stale_us()) {
    sets_.note_no_sync();
    end_interval();
  }
  if (stream_.is_late(now_us, stale_us())) {
    count(counters_.stale);
    interrupted();
    emcy_.raise(Condition::kJointInputStale, counters_.stale);
  }
  // Targets come and no set goes out. In inline mode this stops the arm in every NMT state.
  const bool is_ours = mode_ == Mode::kInline || stream_.takes_targets();
  if (stream_.waits_too_long() && phase_ != Phase::kLeaving && mode_ != Mode::kForward &&
      is_configured() && is_ours) {
    emcy_.raise(Condition::kSetsWithheld, why_withheld(now_us));
  }
}

bool JointPath::process(std::uint64_t now_us) {
  const bool late = now_us - last_process_us_ > kSupervisionUs;
  const bool overlooked = stream_.is_late(now_us, stale_us() + kSupervisionUs);
  last_process_us_ = now_us;
  follow_drives();
  watch_stream(now_us);
  // In every turn, because a reset of communication ends all conditions, but not this reason.
  if (changed_reference_ != 0) emcy_.raise(Condition::kReferenceChanged, changed_reference_);
  inputs_.watch(phase_ == Phase::kUnknown ? 0 : compensator_.needed_inputs(), now_us);
  return !late && !overlooked;
}

void JointPath::stop() {
  take_back();
  take_back_unsent();
  sets_.drop();
  start_.stop();
  sets_pass_ = false;
  stream_.end_wait();
  emcy_.clear(Condition::kSetsWithheld);
  if (stream_.is_streaming()) interrupted();
}

bool JointPath::leave(std::uint64_t now_us) {
  if (phase_ == Phase::kUnknown) return false;
  if (phase_ != Phase::kLeaving) {
    take_back();
    take_back_unsent();
    compensator_.park();
    phase_ = Phase::kLeaving;
    leaving_since_us_ = now_us;
  }
  const std::uint64_t limit_us = std::max(kLeaveUs, kLeaveCycles * compensator_.cycle_us());
  if (compensator_.is_fading() && now_us - leaving_since_us_ < limit_us) return true;
  forget();
  return false;
}

bool JointPath::fade(std::uint64_t now_us) {
  // In a stream its sets take the steps, unless the output is ending.
  const bool is_ours = phase_ == Phase::kLeaving || !stream_.is_streaming();
  const bool is_allowed = mode_ == Mode::kOffset || phase_ == Phase::kSuspended;
  const bool is_due = phase_ != Phase::kUnknown && is_ours && is_allowed &&
                      sets_.progress() != SetProgress::kComputed && compensator_.is_fading() &&
                      now_us - last_step_us_ >= compensator_.cycle_us();
  if (!is_due || !may_compute()) return false;
  take_back_unsent();
  read_surroundings(now_us);
  // Inline, a fade sends nothing: a drive that follows keeps its last corrected target, and that
  // correction is still subtracted from its actual position.
  input_.held = mode_ == Mode::kInline ? static_cast<std::uint8_t>(~axes_away()) : 0;
  output_ = compensator_.cycle(input_);
  computed_us_ = now_us;
  publish();
  return true;
}

void JointPath::note_offsets(std::uint32_t refused, std::uint32_t unsent, std::uint64_t now_us) {
  if (mode_ != Mode::kOffset || phase_ == Phase::kUnknown) return;
  unsent_ = static_cast<std::uint8_t>(unsent);
  // An offset that still waits for SYNC is not refused, but it is not known to be taken either.
  is_refused_ = refused != 0 || (is_refused_ && unsent != 0);
  for (std::uint32_t k = 0; k < refused; ++k) count(counters_.output_refused);
  if (refused != 0) take_back_unsent();
  if (is_offset_set_ && !is_refused_) note_set_out(now_us);
  is_offset_set_ = false;
}

void JointPath::note_discarded(const Discarded& discarded) {
  if (discarded.axes == 0 || phase_ == Phase::kUnknown) return;
  take_back();
  take_back_unsent();
  if (mode_ == Mode::kInline) inline_output_.hold_up();
  for (std::size_t axis = 0; axis < joint_count_; ++axis) {
    if ((discarded.axes >> axis & 1U) == 0) continue;
    const auto later = static_cast<std::uint8_t>(last_cycle_ - discarded.cycle[axis]);
    compensator_.take_back_cycles(axis, later + 1U);
    dictionary_.set(od::axis::kPositionOffset[axis], compensator_.correction_of(last_cycle_, axis));
  }
}

}  // namespace armtrue::canopen
