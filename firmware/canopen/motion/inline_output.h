// What inline mode sends to the drives: corrected sets, and stop commands that do not wait for one.
//
// After the drives' bus has discarded outputs, sets go out one at a time until one has left again,
// so that a bus that comes back gets no burst of them.
#ifndef ARMTRUE_FIRMWARE_CANOPEN_MOTION_INLINE_OUTPUT_H_
#define ARMTRUE_FIRMWARE_CANOPEN_MOTION_INLINE_OUTPUT_H_

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>

#include "firmware/canopen/motion/sets/set_assembler.h"
#include "firmware/canopen/motion/stop_forwarder.h"
#include "firmware/canopen/protocol/can_port.h"
#include "firmware/core/compensator.h"

namespace armtrue::canopen {

class InlineOutput {
 public:
  // `downstream`: nullptr with one bus, where inline mode is refused.
  explicit InlineOutput(CanPort* downstream) : downstream_(downstream) {}

  // What was sent before does not count any more.
  void forget_sent() { stops_.forget(); }

  struct SentSet {
    std::size_t frames = 0;   // that the bus took, in the order of arrival
    std::uint8_t unsent = 0;  // bit k: the target of axis k is in a frame that it refused
  };
  // Sends the frames of a set. Their targets of `axes` (bit k: axis k) are replaced by those of
  // `output`; all other bytes stay.
  SentSet send(std::span<const SetAssembler::Held> frames, const CycleOutput& output,
               std::uint32_t axes);

  // Passes on the stop command in a target frame if its drive was sent another one last, or `again`
  // is set. Returns false if the bus refused it.
  bool forward_stop(const Pdo& pdo, const CanFrame& frame, bool again);

  // A frame was passed on unchanged.
  void note_forwarded(const Pdo& pdo, const CanFrame& frame) {
    if (frame.len >= pdo.mapping.length) stops_.note_sent(pdo, frame);
  }

  // The bus discarded outputs that it had accepted.
  void hold_up() {
    is_held_up_ = true;
    tried_at_.reset();
  }
  void release() { is_held_up_ = false; }
  bool is_held_up() const { return is_held_up_; }

 private:
  bool may_send();

  CanPort* downstream_;
  StopForwarder stops_;
  bool is_held_up_ = false;
  std::optional<std::uint32_t> tried_at_;  // commands accepted with the set that was tried
};

}  // namespace armtrue::canopen

#endif  // ARMTRUE_FIRMWARE_CANOPEN_MOTION_INLINE_OUTPUT_H_
