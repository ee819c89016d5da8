// A queue of bytes between a serial driver and its interrupt. It does not lock: the caller does.
#ifndef ARMTRUE_FIRMWARE_PORTS_COMMON_BYTE_QUEUE_H_
#define ARMTRUE_FIRMWARE_PORTS_COMMON_BYTE_QUEUE_H_

#include <array>
#include <cstddef>
#include <cstdint>

namespace armtrue::ports {

template <std::size_t kCapacity>
class ByteQueue {
  static_assert((kCapacity & (kCapacity - 1)) == 0, "a power of two");

 public:
  std::size_t size() const { return head_ - tail_; }
  std::size_t room() const { return kCapacity - size(); }

  // False where the queue is full.
  bool push(std::uint8_t byte) {
    if (room() == 0) return false;
    bytes_[head_++ % kCapacity] = byte;
    return true;
  }

  // False where the queue is empty.
  bool pop(std::uint8_t& byte) {
    if (size() == 0) return false;
    byte = bytes_[tail_++ % kCapacity];
    return true;
  }

 private:
  std::array<std::uint8_t, kCapacity> bytes_;
  std::uint32_t head_ = 0;
  std::uint32_t tail_ = 0;
};

}  // namespace armtrue::ports

#endif  // ARMTRUE_FIRMWARE_PORTS_COMMON_BYTE_QUEUE_H_
