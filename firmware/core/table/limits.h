// Compile-time bounds of the compensator. A table may ask for less, never for more.
#ifndef ARMTRUE_FIRMWARE_CORE_TABLE_LIMITS_H_
#define ARMTRUE_FIRMWARE_CORE_TABLE_LIMITS_H_

#include <cstddef>
#include <cstdint>

namespace armtrue {

inline constexpr std::size_t kMaxJoints = 8;
inline constexpr std::size_t kMaxSensors = 8;  // temperature sensors
inline constexpr std::size_t kMaxTools = 4;
inline constexpr std::size_t kMaxMassSets = 32;  // masses of the arm and fitted mass moments
inline constexpr std::size_t kMaxSlots = 384;    // state variables and nodes of the term list
inline constexpr std::size_t kMaxTerms = 512;
inline constexpr std::size_t kMaxHarmonics = 192;
inline constexpr std::size_t kMaxSlowWaves = 64;
inline constexpr std::size_t kMaxGridAxes = 4;
inline constexpr std::size_t kSerialLength = 24;             // bytes of the robot's serial
inline constexpr std::size_t kMaxImageLength = 16U * 1024U;  // one table slot
inline constexpr std::size_t kFeedbackHistory = 16;  // cycles for which a delta is remembered

// Most instructions that a control cycle may take with any table (counted by table_cost.h): 0.3 ms
// of an STM32F405 at 168 MHz if nothing waits for the flash, less than a third of a 1 kHz cycle.
// Exported tables of a six-axis arm with everything in them count 26 000 to 39 000.
inline constexpr std::uint32_t kCycleBudget = 50'000;

// Largest correction of one joint and fastest change of it, whatever a table says. Revolute joints
// in turns (2^-32), prismatic joints in metres (2^-32).
// 0.05 turn is 18 degrees: far above any calibration, far below a collision with another posture.
inline constexpr std::int32_t kMaxDeltaRevolute = 214748365;   // 0.05 turn
inline constexpr std::int32_t kMaxDeltaPrismatic = 429496730;  // 0.1 m
inline constexpr std::int32_t kMaxRateRevolute = 429496730;    // 0.1 turn per second
inline constexpr std::int32_t kMaxRatePrismatic = 858993459;   // 0.2 m per second
// Lowest rate limit that a table may have, 2^-32 turn or metre per second: one unit in the shortest
// cycle of a device (62 us), so that no rate rounds to zero and every fade ends.
inline constexpr std::int32_t kMinRate = 16384;
inline constexpr std::uint16_t kMinBlendMilliseconds = 20;  // enabling, disabling and switching

}  // namespace armtrue

#endif  // ARMTRUE_FIRMWARE_CORE_TABLE_LIMITS_H_
