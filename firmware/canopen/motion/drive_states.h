// What the drives do, as far as they say it: state (0x6041), mode of operation (0x6061), whether an
// actual position jumped while nothing moved, and whether it moved while there were no targets.
//
// A drive that is not in operation, or follows something else than cyclic positions (homing,
// torque, hand-guiding), does not take a corrected target, and the correction does not belong into
// its actual position. A drive that has said nothing is taken to follow.
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
  kUnknown,    // neither its state nor its mode has been heard
  kFollowing,  // operation enabled, a cyclic position mode
  kAway,
};

class DriveStates {
 public:
  // What is mapped no more is not known any more: it would never change. Bit k: of axis k.
  void keep(std::uint32_t states, std::uint32_t modes);

  void hear_state(std::size_t axis, std::uint16_t statusword);
  void hear_mode(std::size_t axis, std::int8_t mode);

  AxisState state(std::size_t axis) const;
  // Bit k: the state or the mode of axis k has been heard.
  std::uint8_t known() const;
  // Bit k: axis k does not follow its targets.
  std::uint8_t away() const;
  // Bit k: axis k has said that it is not in operation.
  std::uint8_t disabled() const;

  // An actual position. `at_rest`: no target has moved for a while. Returns true if it jumped as no
  // arm can: its encoder's zero has been changed. `per_turn`: increments, 0 where not known.
  bool hear_position(std::size_t axis, std::int32_t actual, bool at_rest, std::uint32_t per_turn,
                     const PositionBounds& bounds, std::uint64_t now_us);

  // The stream of targets has ended: where each drive stands now is noted.
  void note_stand();
  // Whether the newest actual position is further than `band` from the one noted. False where none
  // was heard.
  bool has_left(std::size_t axis, std::int32_t band, const PositionBounds& bounds) const;

  // From rest, an arm does not move further than this (in parts of a turn or a metre) from one
  // actual position to the next, nor faster than kFastestTurns a second.
  static constexpr std::uint32_t kJumpPart = 500;
  static constexpr std::uint32_t kFastestTurns = 2;
  // Whether any actual position has been heard within kSilentUs.
  bool is_speaking(std::uint64_t now_us) const;
  static constexpr std::uint64_t kSilentUs = 1'000'000;

  // Positions that lie further apart in time say nothing.
  static constexpr std::uint64_t kNeighboursUs = 100'000;

 private:
  struct Axis {
    std::optional<std::uint16_t> statusword;
    std::optional<std::int8_t> mode;
    std::optional<std::int32_t> actual;
    std::optional<std::int32_t> noted;  // by note_stand()
    std::uint64_t heard_us = 0;         // when `actual` was
  };
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
