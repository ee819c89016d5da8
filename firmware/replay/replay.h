// Plays recorded control cycles through a Compensator: the same code on the host and in an ARM test
// image, so that their outputs can be compared bit for bit.
//
// Recording, little-endian 32-bit words: kMagic, joints, cycle time in µs, number of cycles, length
// of table A and of table B in bytes (multiples of 4); both tables; then one RecordedCycle per
// cycle. Result: one PlayedCycle per cycle. A file may hold many recordings.
#ifndef ARMTRUE_FIRMWARE_REPLAY_REPLAY_H_
#define ARMTRUE_FIRMWARE_REPLAY_REPLAY_H_

#include <array>
#include <cstddef>
#include <cstdint>

#include "firmware/core/compensator.h"

namespace armtrue::replay {

inline constexpr std::uint32_t kMagic = 0x59504C52;  // "RLPY"

struct RecordingHead {
  std::uint32_t magic;
  std::uint32_t joints;
  std::uint32_t cycle_us;
  std::uint32_t cycles;
  std::uint32_t length_a;
  std::uint32_t length_b;
};

// Action of the background loop before a cycle.
enum class Request : std::uint32_t {
  kNone = 0,
  kActivateA = 1,
  kActivateB = 2,
  kDisable = 3,
  kRefuseA = 4,  // load table A, which must be refused
};

struct RecordedCycle {
  std::uint32_t request;
  std::int32_t target[kMaxJoints];
  std::int32_t temperature_mdegc[kMaxSensors];
  std::uint32_t temperature_valid;
  std::int32_t payload_g;
  std::uint32_t time_ms;
};

struct PlayedCycle {
  std::int32_t corrected[kMaxJoints];
  std::int32_t delta[kMaxJoints];
  std::uint32_t flags_and_state;  // flags in the lower half
  std::uint32_t instructions;     // of Compensator::cycle(); 0 where nothing counts them
};

// A file to read or write; both return false at its end or on an error.
struct Input {
  bool (*read)(void* context, void* data, std::size_t size);
  void* context;
};
struct Output {
  bool (*write)(void* context, const void* data, std::size_t size);
  void* context;
};
// Instructions since start, and between two readings; null pointers if nothing counts them.
struct Counter {
  std::uint32_t (*read)();
  std::uint32_t (*between)(const void* context, std::uint32_t before, std::uint32_t after);
  const void* context;
};

enum class Outcome : std::uint32_t {
  kPlayed = 0,
  kBadRecording = 1,
  kTableRefused = 2,
  kCannotWrite = 3,
  kTableTaken = 4,  // a table that must be refused was accepted
  kEnd = 5,         // no further recording
};

// Memory that a replay needs: two table slots and the compensator.
struct Player {
  alignas(4) std::array<std::uint8_t, kMaxImageLength> table_a;
  alignas(4) std::array<std::uint8_t, kMaxImageLength> table_b;
  alignas(Compensator) std::array<std::uint8_t, sizeof(Compensator)> compensator;
};

// Plays the recordings of a file one after the other; kPlayed if there was one and all were played.
Outcome play_all(Player& player, const Input& input, const Output& output, const Counter& counter);

}  // namespace armtrue::replay

#endif  // ARMTRUE_FIRMWARE_REPLAY_REPLAY_H_
