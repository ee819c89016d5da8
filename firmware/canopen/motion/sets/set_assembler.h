// Decides which target frames form the set of one cycle.
//
// An *interval* collects the frames of one cycle. It ends with SYNC if SYNC is in use, otherwise
// with the set window or a newer frame of the same RPDO. SetContent and SetProgress are its state.
// No set is ever repeated, completed from an older cycle or extrapolated.
#ifndef ARMTRUE_FIRMWARE_CANOPEN_MOTION_SETS_SET_ASSEMBLER_H_
#define ARMTRUE_FIRMWARE_CANOPEN_MOTION_SETS_SET_ASSEMBLER_H_

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include "firmware/canopen/motion/sets/set_window.h"
#include "firmware/canopen/protocol/pdo.h"

namespace armtrue::canopen {

// Content of an interval.
enum class SetContent : std::uint8_t {
  kPartial,
  kWhole,
  kSpoilt,  // contradicting targets, or a frame that was too short: the set is not sent
};

// How far the set of an interval has been processed.
enum class SetProgress : std::uint8_t {
  kWaiting,
  kComputed,  // corrected, waits for SYNC
  kOut,
};

// Result of take().
enum class SetEvent : std::uint8_t {
  kHeld,
  kRepeated,      // the set has these targets already; its other bytes replace those held
  kNextCycle,     // belongs to the next cycle, not taken: end the interval, call take() again
  kShort,         // shorter than its mapping: counts as missing
  kContradicted,  // a different target for the same joints within one SYNC interval
  kReady,         // the set is whole and may go out
};

class SetAssembler {
 public:
  struct Held {
    CanFrame frame;  // as received
    const Pdo* pdo = nullptr;
    std::uint8_t rpdo = 0;
  };

  // Decides from the mappings which RPDOs form a set. If an axis is mapped twice there is no set,
  // because its drive would get one of two targets.
  void configure(const PdoTable& pdos);
  // Whether a set has the targets of all `axes` (bit k: axis k).
  bool has_targets_of(std::uint32_t axes) const {
    return expected_ != 0 && (mapped_ & axes) == axes;
  }
  bool is_synchronous() const { return synchronous_; }
  bool carries_target(std::size_t rpdo) const { return (expected_ >> rpdo & 1U) != 0; }

  SetEvent take(const Pdo& pdo, std::size_t rpdo, const CanFrame& frame, std::uint64_t now_us);

  SetContent content() const { return content_; }
  SetProgress progress() const { return progress_; }
  void set_progress(SetProgress progress) { progress_ = progress; }
  std::span<const Held> frames() const { return std::span(held_).first(held_count_); }

  // Whether the time for the frames of this set is over: the set window or, with SYNC, three
  // quarters of its period if that is longer.
  bool is_over(std::uint32_t configured_us, std::uint64_t now_us) const;
  std::uint32_t window_us(std::uint32_t configured_us) const {
    const std::uint32_t window_us = window_.in_force(configured_us);
    return sync_in_use_ ? window_us : std::min(window_us, window_.bound_us());
  }

  // Outcome of an interval.
  enum class Ended : std::uint8_t { kEmptyOrOut, kWithheld };
  Ended end_interval();

  // The stream was interrupted: the next interval counts as not following a whole one, and the next
  // stream may have another cycle time. drop() also drops the interval.
  void interrupt();
  void drop();

  void note_sync(std::uint64_t now_us);
  void note_no_sync() { sync_in_use_ = false; }
  bool sync_in_use() const { return sync_in_use_; }
  std::uint64_t last_sync_us() const { return last_sync_us_; }
  // Whether the set that waits for SYNC is at most two SYNC intervals old at `now_us`.
  bool is_on_time(std::uint32_t configured_us, std::uint64_t now_us) const;

 private:
  std::uint64_t sync_period_us() const;
  Held* find(std::size_t rpdo, std::size_t count);
  void clear();

  std::array<Held, kAxes> held_ = {};  // of this interval, in the order of arrival
  std::uint8_t held_count_ = 0;
  std::uint8_t out_count_ = 0;  // the first entries of held_ are the set of the last interval
  std::uint32_t mapped_ = 0;    // bit k: a target of axis k is mapped
  std::uint32_t expected_ = 0;  // bit r: RPDO r belongs to the set
  std::uint32_t present_ = 0;
  bool synchronous_ = false;
  bool trusted_ = false;      // the last interval with frames was whole, and nothing is late
  bool sync_in_use_ = false;  // SYNC has come within the stale time-out
  SetContent content_ = SetContent::kPartial;
  SetProgress progress_ = SetProgress::kWaiting;
  std::uint64_t begin_us_ = 0;
  std::uint64_t last_sync_us_ = 0;
  std::array<std::uint64_t, 3> sync_intervals_us_ = {};  // the last three, 0 before the first
  // SYNC intervals in a row without a target frame: now, and before each of the last two intervals
  // that had one.
  std::uint32_t empty_ = 0;
  std::array<std::uint32_t, 2> pauses_ = {};
  SetWindow window_;
};

}  // namespace armtrue::canopen

#endif  // ARMTRUE_FIRMWARE_CANOPEN_MOTION_SETS_SET_ASSEMBLER_H_
