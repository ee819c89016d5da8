#include "firmware/canopen/motion/sets/set_assembler.h"

#include <algorithm>
#include <bit>
#include <cstring>

#include "firmware/core/fixed/counter.h"

namespace armtrue::canopen {
namespace {

bool have_equal_targets(const Pdo& pdo, const CanFrame& one, const CanFrame& other) {
  return std::ranges::all_of(pdo.mapping.used(), [&](const MappedEntry& mapped) {
    return axis_object(mapped.index) != kTargetPosition ||
           std::memcmp(&one.data[mapped.at], &other.data[mapped.at], mapped.size) == 0;
  });
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

void SetAssembler::interrupt() {
  trusted_ = false;
  pauses_ = {};
  window_.restart(expected_);
}

void SetAssembler::drop() {
  clear();
  out_count_ = 0;
  interrupt();
}

SetAssembler::Held* SetAssembler::find(std::size_t rpdo, std::size_t count) {
  const std::span<Held> held = std::span(held_).first(count);
  const auto found = std::ranges::find(held, rpdo, &Held::rpdo);
  return found == held.end() ? nullptr : &*found;
}

SetEvent SetAssembler::take(const Pdo& pdo, std::size_t rpdo, const CanFrame& frame,
                            std::uint64_t now_us) {
  if (frame.len < pdo.mapping.length) {
    content_ = SetContent::kSpoilt;
    return SetEvent::kShort;
  }
  if (Held* same = find(rpdo, held_count_)) {
    if (have_equal_targets(pdo, frame, same->frame)) {
      window_.note(rpdo, now_us);  // an arm at rest may be in its next cycle
      // If the set has not gone out, the newest controlword is the one that has to.
      same->frame = frame;
      return SetEvent::kRepeated;
    }
    if (!sync_in_use_) return SetEvent::kNextCycle;
    // Two different targets for one joint within one SYNC interval: the set is ambiguous and is
    // dropped.
    content_ = SetContent::kSpoilt;
    return SetEvent::kContradicted;
  }
  window_.note(rpdo, now_us);
  // A frame that is repeated behind its set would begin an interval and replace that of the next
  // cycle. The learnt window is too short for a frame of the next cycle.
  const bool may_be_behind =
      !sync_in_use_ && present_ == 0 && now_us - begin_us_ < window_.learnt_us();
  const Held* sent = may_be_behind ? find(rpdo, out_count_) : nullptr;
  if (sent != nullptr && have_equal_targets(pdo, frame, sent->frame)) return SetEvent::kRepeated;
  if (held_count_ == held_.size())
    return SetEvent::kHeld;  // configure() made sure that there is room
  if (present_ == 0) {
    begin_us_ = now_us;
    // Without SYNC nothing ends a set in time before the length of a cycle is known.
    trusted_ = trusted_ && (sync_in_use_ || window_.bound_us() != SetWindow::kUnbounded);
  }
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

bool SetAssembler::is_over(std::uint32_t configured_us, std::uint64_t now_us) const {
  if (present_ == 0 || progress_ == SetProgress::kOut) return false;
  std::uint64_t limit_us = window_us(configured_us);
  if (sync_in_use_) {
    // A whole set waits for SYNC. Missing frames are accepted only while they must belong to this
    // interval: if SYNC is late, a frame of the next cycle may arrive before it.
    if (content_ == SetContent::kWhole) return false;
    limit_us = std::max(limit_us, sync_period_us() * 3 / 4);
  }
  return now_us - begin_us_ > limit_us;
}

SetAssembler::Ended SetAssembler::end_interval() {
  const bool is_withheld = present_ != 0 && progress_ != SetProgress::kOut;
  if (present_ != 0 || content_ == SetContent::kSpoilt) {
    // A frame that is missing here may arrive late and complete the next set with an old target.
    // Therefore the set after an interval that was not whole is not used, even if the frames that
    // came only repeat the targets before: the late one may belong to a joint that moves.
    trusted_ = content_ == SetContent::kWhole;
    pauses_ = {pauses_[1], empty_};
    empty_ = 0;
  } else if (begin_us_ < last_sync_us_) {
    // Targets may be slower than SYNC. If more intervals are empty than lately, a whole cycle is
    // late or lost, and one of its frames may still arrive.
    count(empty_);
    trusted_ = trusted_ && empty_ <= std::max(pauses_[0], pauses_[1]);
  }
  out_count_ = progress_ == SetProgress::kOut ? held_count_ : std::uint8_t{0};
  clear();
  return is_withheld ? Ended::kWithheld : Ended::kEmptyOrOut;
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
