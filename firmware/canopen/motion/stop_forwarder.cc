#include "firmware/canopen/motion/stop_forwarder.h"

#include <algorithm>

namespace armtrue::canopen {
namespace {

// CiA 402-2, controlword: bits 0 to 3 all set command "operation enabled", bit 8 halts the drive.
constexpr std::uint16_t kEnableMask = 0x010F;
constexpr std::uint16_t kEnable = 0x000F;

std::uint16_t controlword_at(const MappedEntry& mapped, const CanFrame& frame) {
  return load_le<std::uint16_t>(&frame.data[mapped.at]);
}

bool is_stop(const MappedEntry& mapped, const CanFrame& frame) {
  return axis_object(mapped.index) == kControlword &&
         (controlword_at(mapped, frame) & kEnableMask) != kEnable;
}

}  // namespace

bool StopForwarder::commands_stop(const Pdo& pdo, const CanFrame& frame) const {
  return std::ranges::any_of(pdo.mapping.used(),
                             [&](const MappedEntry& mapped) { return is_stop(mapped, frame); });
}

bool StopForwarder::is_new(const Pdo& pdo, const CanFrame& frame) const {
  return std::ranges::any_of(pdo.mapping.used(), [&](const MappedEntry& mapped) {
    return is_stop(mapped, frame) &&
           sent_[axis_of(mapped.index)].controlword != controlword_at(mapped, frame);
  });
}

CanFrame StopForwarder::stop_frame(const Pdo& pdo, const CanFrame& frame) const {
  CanFrame stop = frame;
  for (const MappedEntry& mapped : pdo.mapping.used()) {
    const std::uint16_t object = axis_object(mapped.index);
    if (object != kTargetPosition && object != kControlword) continue;
    const Sent& sent = sent_[axis_of(mapped.index)];
    std::uint8_t* place = &stop.data[mapped.at];
    if (object == kTargetPosition && sent.target) store_le(place, *sent.target);
    if (object == kControlword && sent.controlword && !is_stop(mapped, frame)) {
      store_le(place, *sent.controlword);
    }
  }
  return stop;
}

void StopForwarder::note_sent(const Pdo& pdo, const CanFrame& frame) {
  for (const MappedEntry& mapped : pdo.mapping.used()) {
    const std::uint16_t object = axis_object(mapped.index);
    const std::uint8_t* place = &frame.data[mapped.at];
    if (object == kTargetPosition) {
      sent_[axis_of(mapped.index)].target = load_le<std::int32_t>(place);
    } else if (object == kControlword) {
      sent_[axis_of(mapped.index)].controlword = load_le<std::uint16_t>(place);
    }
  }
}

}  // namespace armtrue::canopen
