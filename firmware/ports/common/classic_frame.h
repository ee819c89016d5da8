// Classic CAN frames as the drivers of classic controllers store them.
#ifndef ARMTRUE_FIRMWARE_PORTS_COMMON_CLASSIC_FRAME_H_
#define ARMTRUE_FIRMWARE_PORTS_COMMON_CLASSIC_FRAME_H_

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>

#include "firmware/canopen/protocol/can_port.h"
#include "firmware/canopen/protocol/little_endian.h"
#include "firmware/ports/common/interrupt_lock.h"
#include "firmware/ports/common/queue.h"

namespace armtrue::ports {

// A classic frame in 16 bytes instead of the 72 of a CanFrame.
struct ClassicFrame {
  static constexpr std::uint8_t kCommandFlag = 1U << 7;  // in `flags`: `command` is valid
  std::uint32_t id = 0;
  std::uint8_t flags = 0;
  std::uint8_t len = 0;
  std::array<std::uint8_t, canopen::kClassicPayload> data = {};
  canopen::Command command = {};

  // `frame` must be a classic frame with at most eight bytes. `command`: nullptr for other frames.
  static ClassicFrame from(const canopen::CanFrame& frame, const canopen::Command* command) {
    ClassicFrame classic{frame.id, frame.flags, frame.len, {}, {}};
    std::copy_n(frame.data, frame.len, classic.data.begin());
    if (command != nullptr) {
      classic.flags |= kCommandFlag;
      classic.command = *command;
    }
    return classic;
  }

  void copy_to(canopen::CanFrame& frame) const {
    frame.id = id;
    frame.flags = flags;
    frame.len = len;
    std::copy_n(data.begin(), len, frame.data);
  }

  bool is(canopen::FrameFlags flag) const { return (flags & flag) != 0; }
  bool is_command() const { return (flags & kCommandFlag) != 0; }

  // The payload as two little-endian words.
  std::array<std::uint32_t, 2> words() const {
    return {canopen::load_le<std::uint32_t>(&data[0]), canopen::load_le<std::uint32_t>(&data[4])};
  }
  // `code`: data length code; 9 to 15 stand for eight bytes (ISO 11898-1, 10.4.2.3).
  void set_payload(std::uint32_t code, const std::array<std::uint32_t, 2>& words) {
    len = static_cast<std::uint8_t>(std::min<std::uint32_t>(code, canopen::kClassicPayload));
    canopen::store_le(&data[0], words[0]);
    canopen::store_le(&data[4], words[1]);
  }
};

static_assert(sizeof(ClassicFrame) == 16);

// Whether a classic controller can send this frame as it is.
inline bool is_classic(const canopen::CanFrame& frame) {
  constexpr std::uint8_t kFdFlags =
      canopen::kFrameFd | canopen::kFrameBitRateSwitch | canopen::kFrameErrorState;
  const std::uint32_t largest_id = frame.is(canopen::kFrameExtended) ? 0x1FFFFFFFU : 0x7FFU;
  return (frame.flags & kFdFlags) == 0 && frame.len <= canopen::kClassicPayload &&
         frame.id <= largest_id;
}

// CanPort::receive() of a driver whose interrupt fills `received`.
template <std::size_t kCapacity>
bool take_received(Queue<ClassicFrame, kCapacity>& received, canopen::CanFrame& frame) {
  const InterruptLock lock;
  ClassicFrame classic;
  if (!received.pop(classic)) return false;
  classic.copy_to(frame);
  return true;
}

}  // namespace armtrue::ports

#endif  // ARMTRUE_FIRMWARE_PORTS_COMMON_CLASSIC_FRAME_H_
