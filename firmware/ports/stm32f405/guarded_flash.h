// Flash slots that are not written at a low supply voltage, with a longer timeout of the
// independent watchdog during an erase.
#ifndef ARMTRUE_FIRMWARE_PORTS_STM32F405_GUARDED_FLASH_H_
#define ARMTRUE_FIRMWARE_PORTS_STM32F405_GUARDED_FLASH_H_

#include <cstddef>
#include <cstdint>
#include <span>

#include "firmware/storage/flash.h"

namespace armtrue::stm32f405 {

// An erase stalls the core: it happens only while the drives are disabled (the node refuses it
// otherwise), and the independent watchdog gets a longer timeout. The window watchdog is paused for
// the whole request that erases (main.cc).
template <typename Slots, typename Independent, typename Detector>
class GuardedFlash final : public storage::Flash {
 public:
  // None is owned.
  GuardedFlash(Slots& flash, Independent& independent, const Detector& detector)
      : flash_(flash), independent_(independent), detector_(detector) {}

  std::size_t slot_size() const override { return flash_.slot_size(); }
  void read(std::size_t slot, std::size_t offset, std::span<std::uint8_t> data) const override {
    flash_.read(slot, offset, data);
  }
  bool program(std::size_t slot, std::size_t offset, std::uint32_t word) override {
    return !detector_.is_low() && flash_.program(slot, offset, word);
  }
  bool erase(std::size_t slot) override {
    if (detector_.is_low()) return false;
    independent_.set_timeout(Independent::kEraseMs);
    const bool erased = flash_.erase(slot);
    independent_.set_timeout(Independent::kUsualMs);
    return erased;
  }

 private:
  Slots& flash_;
  Independent& independent_;
  const Detector& detector_;
};

}  // namespace armtrue::stm32f405

#endif  // ARMTRUE_FIRMWARE_PORTS_STM32F405_GUARDED_FLASH_H_
