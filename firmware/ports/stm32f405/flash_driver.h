// Two table slots (or two parameter slots) in the flash of the STM32F405 (ST RM0090, section 3).
//
// A slot is one sector of 128 KiB. Erasing takes 1 to 2 s and programming a word 16 µs (DS8626,
// table 40). Meanwhile the processor, interrupts included, stalls on its next fetch from flash. The
// caller erases only while the arm is at rest, and the watchdog timeout must be longer than that.
#ifndef ARMTRUE_FIRMWARE_PORTS_STM32F405_FLASH_DRIVER_H_
#define ARMTRUE_FIRMWARE_PORTS_STM32F405_FLASH_DRIVER_H_

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include "firmware/ports/common/register_block.h"
#include "firmware/storage/flash.h"

namespace armtrue::stm32f405 {

namespace flash {

// Register offsets and bits, named as in the manual (3.9).
inline constexpr std::uint32_t kAcr = 0x00;
inline constexpr std::uint32_t kKeyr = 0x04;
inline constexpr std::uint32_t kSr = 0x0C;
inline constexpr std::uint32_t kCr = 0x10;
inline constexpr std::uint32_t kKey1 = 0x45670123;
inline constexpr std::uint32_t kKey2 = 0xCDEF89AB;
inline constexpr std::uint32_t kAcrDataCache = 1U << 10;
inline constexpr std::uint32_t kAcrDataCacheReset = 1U << 12;
inline constexpr std::uint32_t kSrBusy = 1U << 16;
inline constexpr std::uint32_t kSrErrors =
    0xF2;  // operation, write protection, alignment, parallelism, sequence
inline constexpr std::uint32_t kCrProgram = 1U << 0;
inline constexpr std::uint32_t kCrSectorErase = 1U << 1;
inline constexpr std::uint32_t kCrSectorShift = 3;
inline constexpr std::uint32_t kCrWords = 2U << 8;  // 32 bits at a time: supply of 2.7 to 3.6 V
inline constexpr std::uint32_t kCrStart = 1U << 16;
inline constexpr std::uint32_t kCrLock = 1U << 31;

inline constexpr std::uint32_t kSectorBytes = 128 * 1024;  // sectors 5 to 11
constexpr std::uintptr_t sector_address(std::uint32_t sector) {
  return 0x08020000 + (sector - 5) * kSectorBytes;
}

}  // namespace flash

// Access to the flash memory itself. A test substitutes a model.
template <typename T>
concept FlashArray = requires(T array, const T constant, std::uintptr_t address,
                              std::uint32_t word) {
  { constant.load(address) } -> std::same_as<std::uint32_t>;
  array.store(address, word);
};

class MappedFlashArray {
 public:
  std::uint32_t load(std::uintptr_t address) const {
    return *reinterpret_cast<const volatile std::uint32_t*>(address);
  }
  void store(std::uintptr_t address, std::uint32_t word) {
    *reinterpret_cast<volatile std::uint32_t*>(address) = word;
  }
};

template <ports::RegisterBlock Registers, FlashArray Array>
class FlashDriver final : public storage::Flash {
 public:
  // `first_sector` and the next one (5 to 11) are the slots. `polls` bounds every wait; the default
  // is far longer than the longest erase.
  FlashDriver(Registers& registers, Array& array, std::uint32_t first_sector,
              std::uint32_t polls = 1'000'000'000)
      : registers_(registers), array_(array), first_sector_(first_sector), polls_(polls) {}

  // Whether there is a flash controller: a real one is locked after reset.
  bool is_present() const { return (registers_.read(flash::kCr) & flash::kCrLock) != 0; }

  std::size_t slot_size() const override { return flash::kSectorBytes; }
  void read(std::size_t slot, std::size_t offset, std::span<std::uint8_t> data) const override;
  bool program(std::size_t slot, std::size_t offset, std::uint32_t word) override;
  bool erase(std::size_t slot) override;

 private:
  std::uintptr_t address_of(std::size_t slot) const {
    return flash::sector_address(first_sector_ + static_cast<std::uint32_t>(slot));
  }
  bool begin();
  bool end();

  Registers& registers_;
  Array& array_;
  std::uint32_t first_sector_;
  std::uint32_t polls_;
};

template <ports::RegisterBlock Registers, FlashArray Array>
void FlashDriver<Registers, Array>::read(std::size_t slot, std::size_t offset,
                                         std::span<std::uint8_t> data) const {
  std::uintptr_t address = address_of(slot) + offset;
  for (std::uint8_t& byte : data) {
    byte =
        static_cast<std::uint8_t>(array_.load(address & ~std::uintptr_t{3}) >> (8 * (address & 3)));
    ++address;
  }
}

template <ports::RegisterBlock Registers, FlashArray Array>
bool FlashDriver<Registers, Array>::begin() {
  if (!ports::wait_for(registers_, flash::kSr, flash::kSrBusy, 0, polls_)) return false;
  if ((registers_.read(flash::kCr) & flash::kCrLock) != 0) {
    registers_.write(flash::kKeyr, flash::kKey1);
    registers_.write(flash::kKeyr, flash::kKey2);
  }
  registers_.write(flash::kSr, flash::kSrErrors);  // written ones clear
  return (registers_.read(flash::kCr) & flash::kCrLock) == 0;
}

// Waits for the operation, locks the controller and tells whether it succeeded.
template <ports::RegisterBlock Registers, FlashArray Array>
bool FlashDriver<Registers, Array>::end() {
  const bool done = ports::wait_for(registers_, flash::kSr, flash::kSrBusy, 0, polls_);
  const bool correct = (registers_.read(flash::kSr) & flash::kSrErrors) == 0;
  registers_.write(flash::kCr, flash::kCrLock);
  return done && correct;
}

template <ports::RegisterBlock Registers, FlashArray Array>
bool FlashDriver<Registers, Array>::program(std::size_t slot, std::size_t offset,
                                            std::uint32_t word) {
  if (offset % 4 != 0 || offset + 4 > slot_size() || !begin()) return false;
  registers_.write(flash::kCr, flash::kCrProgram | flash::kCrWords);
  array_.store(address_of(slot) + offset, word);
  return end();
}

template <ports::RegisterBlock Registers, FlashArray Array>
bool FlashDriver<Registers, Array>::erase(std::size_t slot) {
  if (!begin()) return false;
  const std::uint32_t sector = first_sector_ + static_cast<std::uint32_t>(slot);
  const std::uint32_t command =
      flash::kCrSectorErase | flash::kCrWords | (sector << flash::kCrSectorShift);
  registers_.write(flash::kCr, command);
  registers_.write(flash::kCr, command | flash::kCrStart);
  const bool erased = end();
  // The data cache may still hold the old content (3.5.3); it can be reset only while it is off.
  const std::uint32_t control = registers_.read(flash::kAcr);
  registers_.write(flash::kAcr, control & ~flash::kAcrDataCache);
  registers_.write(flash::kAcr, (control & ~flash::kAcrDataCache) | flash::kAcrDataCacheReset);
  registers_.write(flash::kAcr, control & ~flash::kAcrDataCacheReset);
  return erased;
}

}  // namespace armtrue::stm32f405

#endif  // ARMTRUE_FIRMWARE_PORTS_STM32F405_FLASH_DRIVER_H_
