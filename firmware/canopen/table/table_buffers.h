// Who may write where: two buffers of one table each, and the only way to a byte of either.
//
// One holds the image in force (or nothing), the other is staged into. Write access is handed out
// for the latter alone, and only while the compensator reads neither of its bytes; whether it does
// is asked each time. They swap when a staged table is put in force.
#ifndef ARMTRUE_FIRMWARE_CANOPEN_TABLE_TABLE_BUFFERS_H_
#define ARMTRUE_FIRMWARE_CANOPEN_TABLE_TABLE_BUFFERS_H_

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include "firmware/core/compensator.h"

namespace armtrue::canopen {

// Where a port has the two, each as large as the largest table.
struct TableMemory {
  std::span<std::uint8_t> first;
  std::span<std::uint8_t> second;
};

class TableBuffers {
 public:
  TableBuffers(const TableMemory& memory, const Compensator& reader)
      : memory_{memory.first, memory.second}, reader_(reader) {}

  // The buffer that is staged into, all of it, for writing. Empty while something reads it.
  std::span<std::uint8_t> writable() const {
    return reader_.is_in_use(spare()) ? std::span<std::uint8_t>() : spare();
  }
  // What was staged: the first `length` bytes.
  std::span<const std::uint8_t> staged(std::size_t length) const { return spare().first(length); }
  std::size_t capacity() const { return spare().size(); }

  // What is in force; empty for nothing.
  std::span<const std::uint8_t> active() const { return active_; }

  // `image`, which lies in the buffer that was written, is in force from now on. An empty one
  // leaves nothing in force. Anything else changes nothing.
  void put_in_force(std::span<const std::uint8_t> image) {
    if (!image.empty() && image.data() != spare().data()) return;
    if (!image.empty()) spare_ = 1U - spare_;
    active_ = image;
  }

 private:
  std::span<std::uint8_t> spare() const { return memory_[spare_]; }

  std::array<std::span<std::uint8_t>, 2> memory_;
  const Compensator& reader_;
  std::size_t spare_ = 0;
  std::span<const std::uint8_t> active_;
};

}  // namespace armtrue::canopen

#endif  // ARMTRUE_FIRMWARE_CANOPEN_TABLE_TABLE_BUFFERS_H_
