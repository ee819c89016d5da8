// Two buffers of one table each; all access to them goes through this class.
//
// One holds the image in force (or nothing), the other is the staging buffer. Only the staging
// buffer may be written, and only while the compensator does not read it, which is checked at each
// access. The buffers swap when a staged table is put in force.
#ifndef ARMTRUE_FIRMWARE_CANOPEN_TABLE_TABLE_BUFFERS_H_
#define ARMTRUE_FIRMWARE_CANOPEN_TABLE_TABLE_BUFFERS_H_

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include "firmware/core/compensator.h"

namespace armtrue::canopen {

// A port's memory for the two buffers, each as large as the largest table.
struct TableMemory {
  std::span<std::uint8_t> first;
  std::span<std::uint8_t> second;
};

class TableBuffers {
 public:
  TableBuffers(const TableMemory& memory, const Compensator& reader)
      : memory_{memory.first, memory.second}, reader_(reader) {}

  // The whole staging buffer, for writing. Empty while the compensator reads it.
  std::span<std::uint8_t> writable() const {
    return reader_.is_in_use(spare()) ? std::span<std::uint8_t>() : spare();
  }
  // The first `length` bytes of the staging buffer.
  std::span<const std::uint8_t> staged(std::size_t length) const { return spare().first(length); }
  std::size_t capacity() const { return spare().size(); }

  // The image in force; empty if there is none.
  std::span<const std::uint8_t> active() const { return active_; }

  // Puts `image`, which begins the staging buffer, in force and swaps the buffers. An empty image
  // leaves nothing in force. Any other image is ignored.
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
