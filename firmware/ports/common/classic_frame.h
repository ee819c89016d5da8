// A queue of classic frames between a driver and its interrupt. It does not lock: the caller does.
#ifndef ARMTRUE_FIRMWARE_PORTS_COMMON_FRAME_QUEUE_H_
#define ARMTRUE_FIRMWARE_PORTS_COMMON_FRAME_QUEUE_H_

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>

#include "firmware/canopen/protocol/can_port.h"

namespace armtrue::ports {

// A classic frame in 16 bytes instead of the 72 of a CanFrame.
struct ClassicFrame {
  std::uint32_t id = 0;
  std::uint8_t flags = 0;
  std::uint8_t len = 0;
  std::array<std::uint8_t, canopen::kClassicPayload> data = {};

  // `frame` must be a classic frame with at most eight bytes.
  static ClassicFrame from(const canopen::CanFrame& frame) {
    ClassicFrame classic{frame.id, frame.flags, frame.len, {}};
    std::copy_n(frame.data, frame.len, classic.data.begin());
    return classic;
  }

  void copy_to(canopen::CanFrame& frame) const {
    frame.id = id;
    frame.flags = flags;
    frame.len = len;
    std::copy_n(data.begin(), len, frame.data);
  }
};

// Whether a classic controller can send this frame as it is.
inline bool is_classic(const canopen::CanFrame& frame) {
  constexpr std::uint8_t kFdFlags =
      canopen::kFrameFd | canopen::kFrameBitRateSwitch | canopen::kFrameErrorState;
  const std::uint32_t largest_id = frame.is(canopen::kFrameExtended) ? 0x1FFFFFFFU : 0x7FFU;
  return (frame.flags & kFdFlags) == 0 && frame.len <= canopen::kClassicPayload &&
         frame.id <= largest_id;
}

template <std::size_t kCapacity>
class FrameQueue {
  static_assert((kCapacity & (kCapacity - 1)) == 0, "a power of two");

 public:
  bool empty() const { return head_ == tail_; }
  bool full() const { return head_ - tail_ == kCapacity; }
  std::size_t size() const { return head_ - tail_; }
  void clear() { tail_ = head_; }

  // False where the queue is full.
  bool push(const ClassicFrame& frame) {
    if (full()) return false;
    frames_[head_++ % kCapacity] = frame;
    return true;
  }

  // False where the queue is empty.
  bool pop(ClassicFrame& frame) {
    if (empty()) return false;
    frame = frames_[tail_++ % kCapacity];
    return true;
  }

 private:
  std::array<ClassicFrame, kCapacity> frames_;
  std::uint32_t head_ = 0;
  std::uint32_t tail_ = 0;
};

inline void count_up(std::uint32_t& counter) {
  if (counter != UINT32_MAX) ++counter;
}

}  // namespace armtrue::ports

#endif  // ARMTRUE_FIRMWARE_PORTS_COMMON_FRAME_QUEUE_H_
