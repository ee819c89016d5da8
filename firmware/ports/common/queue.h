// A queue between a driver and its interrupt handler. The caller locks out interrupts.
#ifndef ARMTRUE_FIRMWARE_PORTS_COMMON_QUEUE_H_
#define ARMTRUE_FIRMWARE_PORTS_COMMON_QUEUE_H_

#include <array>
#include <cstddef>
#include <cstdint>

namespace armtrue::ports {

template <typename T, std::size_t kCapacity>
class Queue {
  static_assert((kCapacity & (kCapacity - 1)) == 0, "a power of two");

 public:
  bool empty() const { return head_ == tail_; }
  std::size_t room() const { return kCapacity - (head_ - tail_); }
  void clear() { tail_ = head_; }

  // False where the queue is full.
  bool push(const T& item) {
    if (room() == 0) return false;
    items_[head_++ % kCapacity] = item;
    return true;
  }

  // Removes the items for which `is_over` is true. The others keep their order.
  template <typename Predicate>
  void erase_if(const Predicate& is_over) {
    std::uint32_t kept = tail_;
    for (std::uint32_t at = tail_; at != head_; ++at) {
      if (is_over(items_[at % kCapacity])) continue;
      items_[kept++ % kCapacity] = items_[at % kCapacity];
    }
    head_ = kept;
  }

  std::size_t size() const { return head_ - tail_; }
  // The item before which `place` others leave, less than size().
  const T& operator[](std::size_t place) const { return items_[(tail_ + place) % kCapacity]; }

  // False where the queue is empty.
  bool pop(T& item) {
    if (empty()) return false;
    item = items_[tail_++ % kCapacity];
    return true;
  }

 private:
  std::array<T, kCapacity> items_;
  std::uint32_t head_ = 0;
  std::uint32_t tail_ = 0;
};

}  // namespace armtrue::ports

#endif  // ARMTRUE_FIRMWARE_PORTS_COMMON_QUEUE_H_
