// The time within which all frames of a set must arrive when no SYNC separates the sets.
//
// A controller without SYNC sends the frames of a set and then pauses. The pause separates the
// sets: a missing frame must not be replaced by that of the next cycle. The window starts with the
// value of 0x2000 sub 4; a longer one is learnt if the controller's pause is clearly longer than
// any gap between the frames of a set. Eight rounds make it longer, one makes it shorter: a window
// that is too long for the stream mixes two cycles after a lost frame. So one round also bounds it,
// whatever its configured value.
#ifndef ARMTRUE_FIRMWARE_CANOPEN_MOTION_SETS_SET_WINDOW_H_
#define ARMTRUE_FIRMWARE_CANOPEN_MOTION_SETS_SET_WINDOW_H_

#include <algorithm>
#include <cstddef>
#include <cstdint>

namespace armtrue::canopen {

class SetWindow {
 public:
  // Forgets what was learnt. `expected`: bit r for every RPDO of a set.
  void restart(std::uint32_t expected);

  // A target frame has come.
  void note(std::size_t rpdo, std::uint64_t now_us);

  // The longest time from a set's first frame to its last where SYNC separates the sets.
  // `configured` is 0x2000 sub 4.
  std::uint32_t in_force(std::uint32_t configured_us) const {
    return std::max(learnt_us(), configured_us);
  }
  // The same as learnt from the stream alone; 0 if nothing was learnt.
  std::uint32_t learnt_us() const { return is_learnt_ ? bound_us_ : 0; }

  // Without SYNC a window must not be longer than this: in it, a frame of the next cycle could
  // replace a missing one. UINT32_MAX before the first round.
  std::uint32_t bound_us() const { return bound_us_; }
  static constexpr std::uint32_t kUnbounded = UINT32_MAX;

  // Consecutive rounds that must agree before a window counts as learnt.
  static constexpr std::uint32_t kRounds = 8;
  // The longest gap of a round is the pause if it exceeds this many quarters of the second longest.
  static constexpr std::uint32_t kPauseQuarters = 5;

 private:
  void end_round();
  void begin_round(std::uint64_t now_us);

  std::uint32_t expected_ = 0;
  std::uint32_t seen_ = 0;    // bit r: RPDO r came in this round, since the last frame of anchor_
  std::uint32_t frames_ = 0;  // of this round
  std::uint64_t last_us_ = 0;
  std::uint32_t longest_us_ = 0;  // gaps of this round
  std::uint32_t second_us_ = 0;
  std::uint32_t total_us_ = 0;
  std::uint32_t agreed_ = 0;
  std::uint32_t candidate_us_ = 0;
  std::uint32_t widest_us_ = 0;
  std::uint32_t bound_us_ = kUnbounded;
  bool is_learnt_ = false;
  std::uint8_t anchor_ = 0;  // the RPDO at which rounds begin
};

}  // namespace armtrue::canopen

#endif  // ARMTRUE_FIRMWARE_CANOPEN_MOTION_SETS_SET_WINDOW_H_
