// Interface between the slot store and a flash memory.
#ifndef ARMTRUE_FIRMWARE_STORAGE_FLASH_H_
#define ARMTRUE_FIRMWARE_STORAGE_FLASH_H_

#include <cstddef>
#include <cstdint>
#include <span>

namespace armtrue::storage {

inline constexpr std::size_t kSlots = 2;
inline constexpr std::uint32_t kBlankWord = 0xFFFFFFFF;  // an erased word

// Two equal slots of flash, each erased as a whole and programmed word by word. Calls block until
// the memory is done: an erase may stall the processor for seconds, so the caller makes them only
// while no joint commands arrive.
class Flash {
 public:
  // Bytes of one slot, a multiple of four.
  virtual std::size_t slot_size() const = 0;

  // Copies `data.size()` bytes from `offset` of `slot`. The range must lie inside the slot.
  virtual void read(std::size_t slot, std::size_t offset, std::span<std::uint8_t> data) const = 0;

  // Programs one erased word (little-endian, `offset` a multiple of four). False where the memory
  // reported an error.
  virtual bool program(std::size_t slot, std::size_t offset, std::uint32_t word) = 0;

  // Erases a slot to kBlankWord. False where the memory reported an error.
  virtual bool erase(std::size_t slot) = 0;

 protected:
  ~Flash() = default;
};

}  // namespace armtrue::storage

#endif  // ARMTRUE_FIRMWARE_STORAGE_FLASH_H_
