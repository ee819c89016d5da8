// What the soak's controller and its judge both know: identifiers, limits, the table's correction.
#ifndef ARMTRUE_FIRMWARE_TESTING_SOAK_FACTS_H_
#define ARMTRUE_FIRMWARE_TESTING_SOAK_FACTS_H_

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <numbers>

#include "firmware/canopen/protocol/can_port.h"

namespace armtrue::canopen::soak {

// Joint 1 moves further in a cycle than the largest correction: its target identifies the cycle.
inline constexpr std::int32_t kStep = 400;
inline constexpr std::int32_t kPermitted = 190;  // slightly above the largest correct value
inline constexpr double kIncrementsPerTurn = 1 << 20;
// amplitude 2^22: 2^-10 rad
inline constexpr double kAmplitude = kIncrementsPerTurn / (1024.0 * 2.0 * std::numbers::pi);
inline constexpr std::uint64_t kBlendCycles = 25;
inline constexpr double kBlendStep =
    18.0;  // per cycle of a blend from one limit to the other, increments
inline constexpr double kRateLimit = 104.86;  // 0.1 turn per second: increments a cycle
inline constexpr double kSlack = 1.6;         // roundings, and the second order of the inverse
inline constexpr std::uint32_t kStrangerTarget = 0x40000000;

inline constexpr std::uint32_t kTargetIds[] = {0x220, 0x320, 0x420};
inline constexpr std::uint32_t kFeedbackIds[] = {0x1C0, 0x1C1, 0x1C2};
inline constexpr std::uint32_t kOffsetIds[] = {0x1A0, 0x2A0, 0x3A0};
inline constexpr std::uint64_t kSettles = 135;  // cycles until an arm counts as standing still

inline bool is_target(const CanFrame& frame) {
  return !frame.is(kFrameExtended) && !frame.is(kFrameRemote) &&
         std::find(std::begin(kTargetIds), std::end(kTargetIds), frame.id) != std::end(kTargetIds);
}

inline bool equal(const CanFrame& one, const CanFrame& other) {
  return one.id == other.id && one.flags == other.flags && one.len == other.len &&
         std::equal(one.data, one.data + one.len, other.data);
}

inline double expected_delta(std::int32_t target) {
  return -kAmplitude * std::sin(2.0 * std::numbers::pi * target / kIncrementsPerTurn);
}

}  // namespace armtrue::canopen::soak

#endif  // ARMTRUE_FIRMWARE_TESTING_SOAK_FACTS_H_
