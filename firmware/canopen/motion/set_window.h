// How long a set of targets takes to arrive, where no SYNC says where one ends and the next begins.
//
// A controller without SYNC sends its frames and then pauses. The pause is what tells sets apart: a
// frame that is missing may not be replaced by that of the next cycle. The window that is written
// in 0x2000 sub 4 is where this begins; a controller that takes longer is learnt, provided that its
// pause is clearly longer than any gap between its frames.
#ifndef ARMTRUE_FIRMWARE_CANOPEN_MOTION_SET_WINDOW_H_
#define ARMTRUE_FIRMWARE_CANOPEN_MOTION_SET_WINDOW_H_

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

  // The longest time from a set's first frame to its last. `configured` is 0x2000 sub 4.
  std::uint32_t in_force(std::uint32_t configured_us) const {
    return std::max(learnt_us_, configured_us);
  }

  // Rounds in a row that must agree before a window counts as learnt.
  static constexpr std::uint32_t kRounds = 8;
  // A pause counts as one if it is this many quarters of the longest gap within a set.
  static constexpr std::uint32_t kPauseQuarters = 5;

 private:
  void end_round();
  void begin_round(std::uint64_t now_us);

  std::uint32_t expected_ = 0;
  std::uint32_t seen_ = 0;  // in this round: from a frame to the next of the same RPDO
  std::uint64_t last_us_ = 0;
  std::uint32_t longest_us_ = 0;  // gaps of this round
  std::uint32_t second_us_ = 0;
  std::uint32_t total_us_ = 0;
  std::uint32_t agreed_ = 0;
  std::uint32_t candidate_us_ = 0;
  std::uint32_t widest_us_ = 0;
  std::uint32_t learnt_us_ = 0;
  std::uint8_t anchor_ = 0;  // the RPDO at which rounds begin
};

}  // namespace armtrue::canopen

#endif  // ARMTRUE_FIRMWARE_CANOPEN_MOTION_SET_WINDOW_H_
