// Two slots in memory that a reset does not clear, for a machine without a flash controller (an
// emulator): the content survives a restart of the image, not of the machine.
#ifndef ARMTRUE_FIRMWARE_STORAGE_RAM_FLASH_H_
#define ARMTRUE_FIRMWARE_STORAGE_RAM_FLASH_H_

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <span>

#include "firmware/storage/flash.h"

namespace armtrue::storage {

class RamFlash final : public Flash {
 public:
  // `memory`: both slots, one after the other; a multiple of eight bytes.
  explicit RamFlash(std::span<std::uint8_t> memory) : memory_(memory) {}

  // Erases every slot that is all zeros: memory not written since power-on.
  void start() {
    for (std::size_t slot = 0; slot < kSlots; ++slot) {
      const std::span<std::uint8_t> bytes = memory_.subspan(slot * slot_size(), slot_size());
      if (std::ranges::all_of(bytes, [](std::uint8_t byte) { return byte == 0; })) erase(slot);
    }
  }

  std::size_t slot_size() const override { return memory_.size() / kSlots; }

  void read(std::size_t slot, std::size_t offset, std::span<std::uint8_t> data) const override {
    std::ranges::copy(memory_.subspan(slot * slot_size() + offset, data.size()), data.begin());
  }

  // Like flash, only clears bits.
  bool program(std::size_t slot, std::size_t offset, std::uint32_t word) override {
    if (offset % 4 != 0 || offset + 4 > slot_size()) return false;
    const std::span<std::uint8_t> bytes = memory_.subspan(slot * slot_size() + offset, 4);
    for (std::size_t i = 0; i < 4; ++i) bytes[i] &= static_cast<std::uint8_t>(word >> (8 * i));
    return true;
  }

  bool erase(std::size_t slot) override {
    std::ranges::fill(memory_.subspan(slot * slot_size(), slot_size()), std::uint8_t{0xFF});
    return true;
  }

 private:
  std::span<std::uint8_t> memory_;
};

}  // namespace armtrue::storage

#endif  // ARMTRUE_FIRMWARE_STORAGE_RAM_FLASH_H_
