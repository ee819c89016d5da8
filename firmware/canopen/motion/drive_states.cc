#include "firmware/canopen/motion/drive_states.h"

#include <algorithm>
#include <cstdlib>
#include <utility>

namespace armtrue::canopen {
namespace {

// CiA 402-2, table 30: statusword masks, and the states in which a motor has power.
constexpr std::uint16_t kStateMask = 0x006F;
constexpr std::uint16_t kOperationEnabled = 0x0027;
constexpr std::uint16_t kQuickStopActive = 0x0007;
constexpr std::uint16_t kFaultMask = 0x004F;
constexpr std::uint16_t kFaultReactionActive = 0x000F;
// CiA 402-2, 0x6060.
constexpr std::int8_t kHoming = 6;
constexpr std::int8_t kCyclicPosition = 8;

bool is_enabled(std::uint16_t statusword) { return (statusword & kStateMask) == kOperationEnabled; }
bool has_power(std::uint16_t statusword) {
  return is_enabled(statusword) || (statusword & kStateMask) == kQuickStopActive ||
         (statusword & kFaultMask) == kFaultReactionActive;
}

}  // namespace

void DriveStates::keep(std::uint32_t states, std::uint32_t modes) {
  for (std::size_t k = 0; k < axes_.size(); ++k) {
    if ((states >> k & 1U) == 0) axes_[k].statusword.reset();
    if ((modes >> k & 1U) == 0) axes_[k].mode.reset();
  }
}

void DriveStates::hear_state(std::size_t axis, std::uint16_t statusword) {
  if (axis < axes_.size()) axes_[axis].statusword = statusword;
}

void DriveStates::hear_mode(std::size_t axis, std::int8_t mode) {
  if (axis < axes_.size()) axes_[axis].mode = mode;
}

AxisState DriveStates::state(std::size_t axis) const {
  if (axis >= axes_.size()) return AxisState::kUnknown;
  const Axis& heard = axes_[axis];
  if (!heard.statusword && !heard.mode) return AxisState::kUnknown;
  const bool follows = (!heard.statusword || is_enabled(*heard.statusword)) &&
                       (!heard.mode || *heard.mode == kCyclicPosition);
  return follows ? AxisState::kFollowing : AxisState::kAway;
}

std::uint8_t DriveStates::in(AxisState wanted) const {
  return bits([&](std::size_t k) { return state(k) == wanted; });
}

std::uint8_t DriveStates::disabled() const {
  return bits(
      [this](std::size_t k) { return axes_[k].statusword && !has_power(*axes_[k].statusword); });
}

std::uint8_t DriveStates::placed(std::uint64_t now_us) const {
  return bits([&](std::size_t k) {
    return axes_[k].actual && now_us - axes_[k].heard_us <= kNeighboursUs;
  });
}

bool DriveStates::is_speaking(std::uint64_t now_us) const {
  return std::ranges::any_of(axes_, [now_us](const Axis& axis) {
    return axis.actual && now_us - axis.heard_us <= kSilentUs;
  });
}

// In other modes than the cyclic one an axis moves without targets, and as fast as it can. Homing
// also sets the zero, which may show after the drive is disabled.
bool DriveStates::moves_by_itself(const Axis& axis) {
  if (!axis.mode || *axis.mode == kCyclicPosition) return false;
  return *axis.mode == kHoming || !axis.statusword || has_power(*axis.statusword);
}

bool DriveStates::hear_position(std::size_t axis, std::int32_t actual, bool at_rest,
                                std::uint32_t per_turn, const PositionBounds& bounds,
                                std::uint64_t now_us) {
  if (axis >= axes_.size()) return false;
  Axis& heard = axes_[axis];
  const std::optional<std::int32_t> before = std::exchange(heard.actual, actual);
  const std::uint64_t since_us = now_us - std::exchange(heard.heard_us, now_us);
  if (!before || !at_rest || moves_by_itself(heard) || per_turn == 0 || since_us > kNeighboursUs)
    return false;
  const std::int64_t moved = std::abs(bounds.way(std::int64_t{actual} - *before));
  const std::int64_t least = std::int64_t{per_turn} / kJumpPart;
  const auto fastest =
      static_cast<std::int64_t>(std::uint64_t{per_turn} * kFastestTurns * since_us / 1'000'000U);
  return moved > std::max(least, fastest);
}

void DriveStates::note_stand() {
  for (Axis& axis : axes_) axis.noted = axis.actual;
}

bool DriveStates::has_left(std::size_t axis, std::int32_t band,
                           const PositionBounds& bounds) const {
  const Axis& heard = axes_[axis];
  if (!heard.noted || !heard.actual) return false;
  return std::abs(bounds.way(std::int64_t{*heard.actual} - *heard.noted)) > band;
}

}  // namespace armtrue::canopen
