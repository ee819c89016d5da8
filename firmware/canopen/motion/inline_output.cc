#include "firmware/canopen/motion/inline_output.h"

namespace armtrue::canopen {

bool InlineOutput::may_send() {
  if (!is_held_up_ || !tried_at_) return true;
  is_held_up_ = static_cast<std::int32_t>(downstream_->commands().gone - *tried_at_) < 0;
  return !is_held_up_;
}

InlineOutput::SentSet InlineOutput::send(std::span<const SetAssembler::Held> frames,
                                         const CycleOutput& output, std::uint32_t axes) {
  SentSet sent;
  if (downstream_ == nullptr) return sent;
  bool refused = !may_send();
  for (const SetAssembler::Held& held : frames) {
    CanFrame frame = held.frame;
    std::uint32_t joints = 0;
    for (const MappedEntry& mapped : held.pdo->mapping.used()) {
      if (axis_object(mapped.index) != kTargetPosition) continue;
      const std::size_t axis = axis_of(mapped.index);
      if ((axes >> axis & 1U) == 0) continue;
      store_le(&frame.data[mapped.at], output.corrected[axis]);
      joints |= 1U << axis;
    }
    // After a refused frame the rest of the set is held back too, so that as few joints as possible
    // differ.
    const Command command = {static_cast<std::uint8_t>(joints),
                             static_cast<std::uint8_t>(output.cycle)};
    refused = refused || !downstream_->send_command(frame, command);
    if (refused) {
      sent.unsent = static_cast<std::uint8_t>(sent.unsent | joints);
      continue;
    }
    ++sent.frames;
    stops_.note_sent(*held.pdo, frame);
  }
  if (is_held_up_ && sent.frames != 0) tried_at_ = downstream_->commands().accepted;
  return sent;
}

bool InlineOutput::forward_stop(const Pdo& pdo, const CanFrame& frame, bool again) {
  if (frame.len < pdo.mapping.length || !stops_.commands_stop(pdo, frame)) return true;
  if (!again && !stops_.is_new(pdo, frame)) return true;
  const CanFrame stop = stops_.stop_frame(pdo, frame);
  if (!downstream_->send_command(stop, {})) return false;
  stops_.note_sent(pdo, stop);
  return true;
}

}  // namespace armtrue::canopen
