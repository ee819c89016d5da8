// NMT slave state machine and heartbeat (CiA 301, 7.3.2 and 7.2.8).
#ifndef ARMTRUE_FIRMWARE_CANOPEN_PROTOCOL_NMT_H_
#define ARMTRUE_FIRMWARE_CANOPEN_PROTOCOL_NMT_H_

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>

#include "firmware/canopen/protocol/can_port.h"

namespace armtrue::canopen {

inline constexpr std::uint32_t kNmtCommandId = 0x000;
inline constexpr std::uint32_t kHeartbeatBase = 0x700;

// The numbers are the state values of the heartbeat (CiA 301, table 37).
enum class NmtState : std::uint8_t {
  kInitialising = 0,
  kStopped = 4,
  kOperational = 5,
  kPreOperational = 127,
};

// NMT command specifiers (CiA 301, 7.2.8.3.1).
inline constexpr std::uint8_t kNmtStart = 1;
inline constexpr std::uint8_t kNmtStop = 2;
inline constexpr std::uint8_t kNmtEnterPreOperational = 128;
inline constexpr std::uint8_t kNmtResetNode = 129;
inline constexpr std::uint8_t kNmtResetCommunication = 130;

// Reset that an NMT command requests from the node.
enum class NmtRequest : std::uint8_t { kNone, kResetNode, kResetCommunication };

class Nmt {
 public:
  explicit Nmt(std::uint8_t node_id) : node_id_(node_id) {}

  NmtState state() const { return state_; }

  // Ends initialising: the boot-up message leaves and the node is pre-operational. False if the
  // port did not take the message; call again.
  bool boot(CanPort& port, std::uint64_t now_us);

  // The five commands of the standard; every other number is ignored.
  static bool is_defined(std::uint8_t command) {
    return command == kNmtStart || command == kNmtStop || command == kNmtEnterPreOperational ||
           command == kNmtResetNode || command == kNmtResetCommunication;
  }

  // The command in an NMT frame for this node, 0 for none. Classic frames only, as with SDO.
  std::uint8_t command_in(const CanFrame& frame) const;

  // Whether a command, or 0, takes an operational node out of that state.
  static bool leaves_operational(std::uint8_t command) {
    return command != kNmtStart && is_defined(command);
  }

  // Carries out a command. Transitions take effect at once. A reset is returned for the node to
  // carry out; until then the state is kInitialising.
  NmtRequest apply(std::uint8_t command);

  // Sends the heartbeat when it is due; `producer_ms` is 0x1017, 0 for none.
  void process(CanPort& port, std::uint16_t producer_ms, std::uint64_t now_us);

  // The producer time was written: the next heartbeat leaves now and the period begins anew.
  void restart_heartbeat(std::uint64_t now_us) { next_heartbeat_us_ = now_us; }

 private:
  bool send_state(CanPort& port, NmtState state) const;

  std::uint8_t node_id_;
  NmtState state_ = NmtState::kInitialising;
  std::uint64_t next_heartbeat_us_ = 0;
};

// Watches the heartbeats of other nodes (0x1016).
class HeartbeatConsumer {
 public:
  static constexpr std::size_t kNodes = 8;

  // Sets one slot from its 0x1016 value: node-ID in bits 23..16, time in ms in bits 15..0. Watching
  // begins with the first heartbeat received.
  void configure(std::size_t slot, std::uint32_t value);

  // Takes a heartbeat (identifiers 0x701 to 0x77F). Returns the slot of a node that was lost and is
  // heard again, else nothing.
  std::optional<std::size_t> handle(const CanFrame& frame, std::uint64_t now_us);

  // Extends all deadlines by `deaf_us`, a time in which no frame could be received.
  void excuse(std::uint64_t deaf_us);

  // Returns the slot of a heartbeat that has just been missed. Call until there is none.
  std::optional<std::size_t> process(std::uint64_t now_us);

  std::uint8_t node_of(std::size_t slot) const { return watches_[slot].node_id; }

 private:
  struct Watch {
    std::uint8_t node_id = 0;
    std::uint32_t time_us = 0;
    bool seen = false;
    bool lost = false;
    std::uint64_t deadline_us = 0;
  };
  std::array<Watch, kNodes> watches_ = {};
};

}  // namespace armtrue::canopen

#endif  // ARMTRUE_FIRMWARE_CANOPEN_PROTOCOL_NMT_H_
