#include "firmware/replay/replay.h"

#include <new>
#include <span>

namespace armtrue::replay {
namespace {

bool read_table(const Input& input, std::array<std::uint8_t, kMaxImageLength>& table,
                std::uint32_t length) {
  return length <= table.size() &&
         (length == 0U || input.read(input.context, table.data(), length));
}

CycleInput input_of(const RecordedCycle& recorded) {
  CycleInput input;
  for (std::size_t k = 0; k < kMaxJoints; ++k) {
    input.target[k] = recorded.target[k];
  }
  for (std::size_t s = 0; s < kMaxSensors; ++s) {
    input.temperature_mdegc[s] = recorded.temperature_mdegc[s];
  }
  input.temperature_valid = recorded.temperature_valid;
  input.payload_g = recorded.payload_g;
  input.time_ms = recorded.time_ms;
  return input;
}

bool fulfil(Compensator& compensator, std::uint32_t request, std::span<const std::uint8_t> table_a,
            std::span<const std::uint8_t> table_b) {
  switch (static_cast<Request>(request)) {
    case Request::kActivateA:
      return compensator.load(table_a, {}).accepted() && compensator.activate();
    case Request::kActivateB:
      return compensator.load(table_b, {}).accepted() && compensator.activate();
    case Request::kDisable:
      compensator.disable();
      return true;
    case Request::kRefuseA:
      return !compensator.load(table_a, {}).accepted();
    case Request::kNone:
      return true;
  }
  return false;
}

Outcome play(Player& player, const Input& input, const Output& output, const Counter& counter) {
  RecordingHead head;
  if (!input.read(input.context, &head, sizeof head)) return Outcome::kEnd;
  if (head.magic != kMagic || head.joints > kMaxJoints || head.cycle_us == 0U ||
      !read_table(input, player.table_a, head.length_a) ||
      !read_table(input, player.table_b, head.length_b)) {
    return Outcome::kBadRecording;
  }
  const CompensatorConfig config = {.joint_count = static_cast<std::uint8_t>(head.joints),
                                    .cycle_us = head.cycle_us};
  // In place, in the player: several kilobytes are too much for a small stack.
  Compensator& compensator = *new (player.compensator.data()) Compensator(config);

  for (std::uint32_t i = 0; i < head.cycles; ++i) {
    RecordedCycle recorded;
    if (!input.read(input.context, &recorded, sizeof recorded)) return Outcome::kBadRecording;
    if (!fulfil(compensator, recorded.request, std::span(player.table_a).first(head.length_a),
                std::span(player.table_b).first(head.length_b))) {
      return static_cast<Request>(recorded.request) == Request::kRefuseA ? Outcome::kTableTaken
                                                                         : Outcome::kTableRefused;
    }
    const CycleInput cycle_input = input_of(recorded);
    const std::uint32_t before = counter.read != nullptr ? counter.read() : 0U;
    const CycleOutput cycle_output = compensator.cycle(cycle_input);
    const std::uint32_t after = counter.read != nullptr ? counter.read() : 0U;
    PlayedCycle played;
    for (std::size_t k = 0; k < kMaxJoints; ++k) {
      played.corrected[k] = cycle_output.corrected[k];
      played.delta[k] = cycle_output.delta[k];
    }
    played.flags_and_state =
        cycle_output.flags | (static_cast<std::uint32_t>(cycle_output.state) << 16U);
    played.instructions =
        counter.read != nullptr ? counter.between(counter.context, before, after) : 0U;
    if (!output.write(output.context, &played, sizeof played)) return Outcome::kCannotWrite;
  }
  return Outcome::kPlayed;
}

}  // namespace

Outcome play_all(Player& player, const Input& input, const Output& output, const Counter& counter) {
  std::uint32_t played = 0;
  Outcome outcome = play(player, input, output, counter);
  while (outcome == Outcome::kPlayed) {
    ++played;
    outcome = play(player, input, output, counter);
  }
  if (outcome != Outcome::kEnd) return outcome;
  return played != 0U ? Outcome::kPlayed : Outcome::kBadRecording;
}

}  // namespace armtrue::replay
