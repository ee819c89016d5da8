#include "firmware/canopen/motion/set_assembler.h"

#include <algorithm>
#include <bit>
#include <cstring>

namespace armtrue::canopen {
namespace {

bool has_payload(const CanFrame& frame, std::uint8_t len, const std::uint8_t* data) {
  return frame.len == len && std::memcmp(frame.data, data, len) == 0;
}

}  // namespace

void SetAssembler::configure(const PdoTable& pdos) {
  drop();
  expected_ = 0;
  synchronous_ = false;
  bool is_unique = true;
  for (std::size_t k = 0; k < kRpdos; ++k) {
    const Pdo& pdo = pdos.rpdo(k);
    if (!pdo.valid || !pdo.mapping.has_axis_object(kTargetPosition)) continue;
    expected_ |= 1U << k;
    synchronous_ = synchronous_ || pdo.is_synchronous();
    is_unique = is_unique && !pdos.repeats_target(k);
  }
  mapped_ = mapped_axes(pdos.rpdos(), kTargetPosition);
  if (!is_unique) expected_ = 0;
  window_.restart(expected_);
}

void SetAssembler::clear() {
  present_ = 0;
  held_count_ = 0;
  content_ = SetContent::kPartial;
  progress_ = SetProgress::kWaiting;
}

void SetAssembler::drop() {
  clear();
  trusted_ = false;
}

const SetAssembler::Held* SetAssembler::find(std::size_t rpdo) const {
  const std::span<const Held> held = frames();
  const auto found = std::ranges::find(held, rpdo, &Held::rpdo);
  return found == held.end() ? nullptr : &*found;
}

bool SetAssembler::repeats_previous(const Held& held) const {
  const std::span<const Sent> previous = std::span(previous_).first(previous_count_);
  const auto found = std::ranges::find(previous, held.rpdo, &Sent::rpdo);
  return found != previous.end() && has_payload(held.frame, found->len, found->data.data());
}

SetEvent SetAssembler::take(const Pdo& pdo, std::size_t rpdo, const CanFrame& frame,
                            std::uint64_t now_us) {
  if (frame.len < pdo.mapping.length) {
    content_ = SetContent::kSpoilt;
    return SetEvent::kShort;
  }
  if (const Held* same = find(rpdo)) {
    if (has_payload(frame, same->frame.len, same->frame.data)) return SetEvent::kRepeated;
    if (!sync_in_use_) return SetEvent::kNextCycle;
    // Two different targets for one joint within one SYNC interval: the set is ambiguous and is
    // dropped.
    content_ = SetContent::kSpoilt;
    return SetEvent::kContradicted;
  }
  window_.note(rpdo, now_us);
  if (held_count_ == held_.size())
    return SetEvent::kHeld;  // configure() made sure that there is room
  if (present_ == 0) begin_us_ = now_us;
  held_[held_count_] = {frame, &pdo, static_cast<std::uint8_t>(rpdo)};
  ++held_count_;
  present_ |= 1U << rpdo;
  if (content_ == SetContent::kPartial && present_ == expected_) content_ = SetContent::kWhole;
  // A late frame of the previous cycle could complete this set with an old target. Asynchronous
  // sets are therefore used only after an interval that was whole.
  const bool may_be_mixed = !synchronous_ && !trusted_ && !std::has_single_bit(expected_);
  const bool ready = content_ == SetContent::kWhole && !may_be_mixed;
  return ready ? SetEvent::kReady : SetEvent::kHeld;
}

void SetAssembler::set_progress(SetProgress progress) {
  progress_ = progress;
  if (progress != SetProgress::kOut) return;
  previous_count_ = held_count_;
  for (std::size_t k = 0; k < held_count_; ++k) {
    const CanFrame& frame = held_[k].frame;
    previous_[k].rpdo = held_[k].rpdo;
    previous_[k].len = frame.len;
    std::ranges::copy(frame.data, previous_[k].data.begin());
  }
}

bool SetAssembler::is_over(std::uint32_t configured_us, std::uint64_t now_us) const {
  if (present_ == 0 || progress_ == SetProgress::kOut) return false;
  std::uint64_t limit_us = window_.in_force(configured_us);
  if (sync_in_use_) {
    // A whole set waits for SYNC. Missing frames are accepted only while they must belong to this
    // interval: if SYNC is late, a frame of the next cycle may arrive before it.
    if (content_ == SetContent::kWhole) return false;
    limit_us = std::max(limit_us, sync_period_us() * 3 / 4);
  }
  return now_us - begin_us_ > limit_us;
}

SetAssembler::Ended SetAssembler::end_interval() {
  // If every frame repeats the previous set, nothing was lost.
  const bool only_repeats =
      content_ != SetContent::kSpoilt &&
      std::ranges::all_of(frames(), [this](const Held& one) { return repeats_previous(one); });
  Ended ended = Ended::kEmptyOrOut;
  if (present_ != 0 && progress_ != SetProgress::kOut) {
    ended = only_repeats ? Ended::kOnlyRepeats : Ended::kWithheld;
  }
  // A frame that is missing here may arrive late and complete the next set with an old target.
  // Therefore the set after an interval that was not whole is not used. An arm at rest repeats
  // whole sets: these count as whole, or the stream could never go on.
  const bool is_whole = content_ == SetContent::kWhole;
  if (present_ == 0 || is_whole || !only_repeats) trusted_ = is_whole;
  clear();
  return ended;
}

void SetAssembler::note_sync(std::uint64_t now_us) {
  if (sync_in_use_) {
    const std::uint64_t interval_us = now_us - last_sync_us_;
    auto& [oldest, older, newest] = sync_intervals_us_;
    const bool is_first = newest == 0;
    oldest = is_first ? interval_us : older;
    older = is_first ? interval_us : newest;
    newest = interval_us;
  }
  sync_in_use_ = true;
  last_sync_us_ = now_us;
}

// The median of the last three intervals. A late SYNC makes one interval longer and the next one
// shorter, a lost SYNC makes one longer; neither changes the median.
std::uint64_t SetAssembler::sync_period_us() const {
  const auto& [a, b, c] = sync_intervals_us_;
  return std::max(std::min(a, b), std::min(std::max(a, b), c));
}

bool SetAssembler::is_on_time(std::uint32_t configured_us, std::uint64_t now_us) const {
  // A set that has waited for SYNC longer than two intervals is too old; while the interval is not
  // known, longer than the set window.
  const std::uint64_t period_us = sync_period_us();
  const std::uint64_t waits_us =
      period_us == 0 ? std::uint64_t{window_.in_force(configured_us)} : 2 * period_us;
  return now_us - begin_us_ <= waits_us;
}

}  // namespace armtrue::canopen
