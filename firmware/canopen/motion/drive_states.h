// What the drives report: statusword (0x6041), modes of operation display (0x6061), jumps of an
// actual position at rest, and motion while no targets came.
//
// A drive that is not in "operation enabled", or not in cyclic synchronous position mode (homing,
// torque, hand-guiding; interpolated position mode, whose set-points are 0x60C1), does not take
// corrected targets, so its actual position contains no correction. A drive that has reported
// neither object counts as following.
#ifndef ARMTRUE_FIRMWARE_CANOPEN_MOTION_DRIVE_STATES_H_
#define ARMTRUE_FIRMWARE_CANOPEN_MOTION_DRIVE_STATES_H_

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>

#include "firmware/core/compensator.h"

namespace armtrue::canopen {

inline constexpr std::uint16_t kStatusword = 0x6041;
inline constexpr std::uint16_t kModeDisplay = 0x6061;

enum class AxisState : std::uint8_t {
  kUnknown,    // neither statusword nor mode has been received
  kFollowing,  // operation enabled, cyclic synchronous position mode
  kAway,
};

class DriveStates {
 public:
  // Forgets the statuswords and modes of axes that are no longer mapped (bit k: axis k is mapped):
  // they would never be updated.
  void keep(std::uint32_t states, std::uint32_t modes);

  void hear_state(std::size_t axis, std::uint16_t statusword);
  void hear_mode(std::size_t axis, std::int8_t mode);

  AxisState state(std::size_t axis) const;
  // Bit k: the statusword or the mode of axis k has been received.
  std::uint8_t known() const { return static_cast<std::uint8_t>(~in(AxisState::kUnknown)); }
  // Bit k: axis k does not follow its targets.
  std::uint8_t away() const { return in(AxisState::kAway); }
  // Bit k: the statusword of axis k reports a state in which the motor has no power.
  std::uint8_t disabled() const;

  // Takes an actual position. `at_rest`: no target has changed for a while. `per_turn`: increments
  // per turn or metre, 0 if not known. Returns true if the position jumped further than an arm can
  // move: the encoder's zero was changed. An axis that an enabled drive may be moving in another
  // mode is not judged.
  bool hear_position(std::size_t axis, std::int32_t actual, bool at_rest, std::uint32_t per_turn,
                     const PositionBounds& bounds, std::uint64_t now_us);

  // Notes the drives' actual positions at the end of a stream of targets.
  void note_stand();
  // Whether the newest actual position is more than `band` increments from the noted one. False if
  // either is missing.
  bool has_left(std::size_t axis, std::int32_t band, const PositionBounds& bounds) const;

  // A change at rest is a jump if it exceeds both 1/kJumpPart turn (metre) and kFastestTurns turns
  // (metres) per second: from rest, an arm does not move that far or that fast.
  static constexpr std::uint32_t kJumpPart = 500;
  static constexpr std::uint32_t kFastestTurns = 2;
  // Whether any actual position has been received within kSilentUs.
  bool is_speaking(std::uint64_t now_us) const;
  static constexpr std::uint64_t kSilentUs = 1'000'000;

  // Actual positions further apart in time are not compared, and older ones tell nothing of now.
  static constexpr std::uint64_t kNeighboursUs = 100'000;
  // Bit k: the actual position of axis k has been received within kNeighboursUs.
  std::uint8_t placed(std::uint64_t now_us) const;

 private:
  struct Axis {
    std::optional<std::uint16_t> statusword;
    std::optional<std::int8_t> mode;
    std::optional<std::int32_t> actual;
    std::optional<std::int32_t> noted;  // by note_stand()
    std::uint64_t heard_us = 0;         // when `actual` was received
  };
  static bool moves_by_itself(const Axis& axis);
  std::uint8_t in(AxisState wanted) const;
  template <typename Condition>
  std::uint8_t bits(const Condition& condition) const {
    std::uint8_t result = 0;
    for (std::size_t k = 0; k < axes_.size(); ++k) {
      if (condition(k)) result = static_cast<std::uint8_t>(result | 1U << k);
    }
    return result;
  }

  std::array<Axis, kMaxJoints> axes_ = {};
};

}  // namespace armtrue::canopen

#endif  // ARMTRUE_FIRMWARE_CANOPEN_MOTION_DRIVE_STATES_H_
