// Which actual positions a start may use to find out what the drives hold, and whether the arm
// stands.
#ifndef ARMTRUE_FIRMWARE_CANOPEN_MOTION_START_POSITIONS_H_
#define ARMTRUE_FIRMWARE_CANOPEN_MOTION_START_POSITIONS_H_

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <optional>

namespace armtrue::canopen {

class StartPositions {
 public:
  // Following errors have decayed when the targets have stood for this long.
  static constexpr std::uint32_t kRestUs = 100'000;

  // What the drives hold is unknown from now on: positions heard before do not count.
  void forget() { heard_ = heard_standing_ = 0; }
  // No sets are evaluated from now on: what happens meanwhile tells nothing of a stand.
  void stop() {
    evaluated_since_us_.reset();
    heard_standing_ = 0;
  }

  void note_moved_target(std::uint64_t now_us) {
    resting_since_us_ = now_us;
    heard_standing_ = 0;
  }
  void note_evaluated_set(std::uint64_t now_us) {
    if (!evaluated_since_us_) evaluated_since_us_ = now_us;
  }
  void note_position(std::size_t axis, std::uint64_t now_us) {
    heard_ |= 1U << axis;
    const bool has_stood = evaluated_since_us_ &&
                           now_us - std::max(*evaluated_since_us_, resting_since_us_) >= kRestUs;
    if (has_stood) heard_standing_ |= 1U << axis;
  }

  // Whether no target has changed for kRestUs. The targets of a computed set that waits for SYNC
  // count, too.
  bool is_at_rest(std::uint64_t now_us) const { return now_us - resting_since_us_ >= kRestUs; }
  // Whether the positions of all `axes` (bit k: axis k) were heard; the same, after the arm stood
  // and sets had been evaluated for kRestUs, with no target changed since.
  bool has(std::uint32_t axes) const { return (axes & ~heard_) == 0; }
  bool has_standing(std::uint32_t axes) const { return (axes & ~heard_standing_) == 0; }

 private:
  std::uint32_t heard_ = 0;
  std::uint32_t heard_standing_ = 0;
  std::uint64_t resting_since_us_ = 0;
  std::optional<std::uint64_t> evaluated_since_us_;  // first set that was evaluated after stop()
};

}  // namespace armtrue::canopen

#endif  // ARMTRUE_FIRMWARE_CANOPEN_MOTION_START_POSITIONS_H_
