// Limits how many control cycles have commands that wait in a port.
//
// A port may discard commands that it has accepted. The correction then continues from the cycle
// before the oldest of them, so the compensator must still remember that cycle. Commands are
// discarded after a fixed time, but in that time a short control period makes more cycles than the
// compensator remembers. A new cycle is therefore computed only if, with its own, commands of at
// most kFeedbackHistory - 1 cycles would be waiting.
#ifndef ARMTRUE_FIRMWARE_CANOPEN_PROTOCOL_COMMAND_BACKLOG_H_
#define ARMTRUE_FIRMWARE_CANOPEN_PROTOCOL_COMMAND_BACKLOG_H_

#include <array>
#include <cstdint>

#include "firmware/canopen/protocol/can_port.h"
#include "firmware/core/table/limits.h"

namespace armtrue::canopen {

class CommandBacklog {
 public:
  // Whether cycle `cycle` may be computed. Call before each cycle, with the counts of the port that
  // its commands will go to. Commands leave in the order in which they were accepted.
  bool admits(std::uint32_t cycle, const CommandCounts& commands) {
    accepted_before_[cycle % kFeedbackHistory] = commands.accepted;
    const std::uint32_t oldest = cycle - (kMostCycles - 1);
    const std::uint32_t recent = commands.accepted - accepted_before_[oldest % kFeedbackHistory];
    return commands.accepted - commands.gone <= recent;
  }

  static constexpr std::uint32_t kMostCycles = kFeedbackHistory - 1;

 private:
  // Commands that the port had accepted before each of the last cycles was computed.
  std::array<std::uint32_t, kFeedbackHistory> accepted_before_ = {};
};

}  // namespace armtrue::canopen

#endif  // ARMTRUE_FIRMWARE_CANOPEN_PROTOCOL_COMMAND_BACKLOG_H_
