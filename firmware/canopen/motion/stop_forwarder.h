// Stop commands in target frames, which do not wait for a set.
//
// Inline, a target frame waits for its set, and is dropped if the set does not go out. CiA 402's
// own mapping puts the controlword (0x6040) into the same frame. A controlword that does not
// command "operation enabled" (quick stop, disable voltage, shutdown, switch on, disable operation,
// fault reset) or that sets halt is a stop command. Its frame is passed on at once, and changes
// nothing else: targets, and controlwords of other drives that do enable, are replaced by those
// that were sent last.
#ifndef ARMTRUE_FIRMWARE_CANOPEN_MOTION_STOP_FORWARDER_H_
#define ARMTRUE_FIRMWARE_CANOPEN_MOTION_STOP_FORWARDER_H_

#include <array>
#include <cstdint>
#include <optional>

#include "firmware/canopen/protocol/pdo.h"

namespace armtrue::canopen {

class StopForwarder {
 public:
  // Forgets what was sent.
  void forget() { sent_ = {}; }

  // Whether the frame holds a stop command. For this and all below: frame.len is at least
  // pdo.mapping.length.
  bool commands_stop(const Pdo& pdo, const CanFrame& frame) const;
  // Whether it holds one that differs from the controlword which its drive was sent last.
  bool is_new(const Pdo& pdo, const CanFrame& frame) const;

  // `frame` with the targets and enabling controlwords that were sent last; its own where none was.
  CanFrame stop_frame(const Pdo& pdo, const CanFrame& frame) const;

  // The drives were sent this frame.
  void note_sent(const Pdo& pdo, const CanFrame& frame);

 private:
  struct Sent {
    std::optional<std::int32_t> target;
    std::optional<std::uint16_t> controlword;
  };

  std::array<Sent, kAxes> sent_ = {};
};

}  // namespace armtrue::canopen

#endif  // ARMTRUE_FIRMWARE_CANOPEN_MOTION_STOP_FORWARDER_H_
