// Reset cause, option bytes and supervision of supply and clock of the STM32F405 (ST RM0090;
// sections beside each).
#ifndef ARMTRUE_FIRMWARE_PORTS_STM32F405_SUPPLY_H_
#define ARMTRUE_FIRMWARE_PORTS_STM32F405_SUPPLY_H_

#include <cstdint>

#include "firmware/ports/common/register_block.h"
#include "firmware/ports/common/reset_log.h"

namespace armtrue::stm32f405 {

namespace supply_bits {
// RCC (7.3).
inline constexpr std::uint32_t kRccCr = 0x00;
inline constexpr std::uint32_t kRccCir = 0x0C;
inline constexpr std::uint32_t kRccCsr = 0x74;
inline constexpr std::uint32_t kCrClockSecurity = 1U << 19;
inline constexpr std::uint32_t kCirClockFailed = 1U << 7;
inline constexpr std::uint32_t kCirClockFailedClear = 1U << 23;
inline constexpr std::uint32_t kCsrRemoveFlags = 1U << 24;
inline constexpr std::uint32_t kCsrBrownOut = 1U << 25;
inline constexpr std::uint32_t kCsrPin = 1U << 26;
inline constexpr std::uint32_t kCsrPowerOn = 1U << 27;
inline constexpr std::uint32_t kCsrSoftware = 1U << 28;
inline constexpr std::uint32_t kCsrWatchdog = 1U << 29;
inline constexpr std::uint32_t kCsrWindowWatchdog = 1U << 30;
inline constexpr std::uint32_t kCsrLowPower = 1U << 31;
// PWR (5.4).
inline constexpr std::uint32_t kPwrCr = 0x00;
inline constexpr std::uint32_t kPwrCsr = 0x04;
inline constexpr std::uint32_t kCrDetector = 1U << 4;
inline constexpr std::uint32_t kCrLevelMask = 7U << 5;
inline constexpr std::uint32_t kCrLevel2V9 = 7U << 5;
inline constexpr std::uint32_t kCsrBelowLevel = 1U << 2;
// EXTI (12.3): line 16 is the detector.
inline constexpr std::uint32_t kExtiImr = 0x00;
inline constexpr std::uint32_t kExtiRtsr = 0x08;
inline constexpr std::uint32_t kExtiPr = 0x14;
inline constexpr std::uint32_t kExtiDetector = 1U << 16;
// Option bytes as loaded at reset (3.9.6).
inline constexpr std::uint32_t kFlashOptcr = 0x14;
inline constexpr std::uint32_t kOptcrBrownOutMask = 3U << 2;  // 0: level 3, 2.7 V and more; 3: off
inline constexpr std::uint32_t kOptcrSoftwareWatchdog = 1U << 5;
inline constexpr std::uint32_t kOptcrReadProtectionMask = 0xFFU << 8;
inline constexpr std::uint32_t kOptcrReadProtectionNone = 0xAAU << 8;
inline constexpr std::uint32_t kOptcrCodeSectors = 0xFFU << 16;  // 0 to 7; a zero protects
}  // namespace supply_bits

// Cause of the last reset; clears the flags for the next one. The order of the tests matters:
// power-on sets the flags of the pin and of brown-out as well, and every reset pulls the pin.
template <ports::RegisterBlock Rcc>
ports::ResetCause take_reset_cause(Rcc& rcc) {
  using ports::ResetCause;
  const std::uint32_t flags = rcc.read(supply_bits::kRccCsr);
  ports::set_bits(rcc, supply_bits::kRccCsr, supply_bits::kCsrRemoveFlags);
  if ((flags & supply_bits::kCsrPowerOn) != 0) return ResetCause::kPowerOn;
  if ((flags & supply_bits::kCsrBrownOut) != 0) return ResetCause::kBrownOut;
  if ((flags & supply_bits::kCsrLowPower) != 0) return ResetCause::kLowPower;
  if ((flags & supply_bits::kCsrWindowWatchdog) != 0) return ResetCause::kWindowWatchdog;
  if ((flags & supply_bits::kCsrWatchdog) != 0) return ResetCause::kWatchdog;
  if ((flags & supply_bits::kCsrSoftware) != 0) return ResetCause::kSoftware;
  if ((flags & supply_bits::kCsrPin) != 0) return ResetCause::kPin;
  return ResetCause::kUnknown;
}

// Detects a supply below 2.9 V, where nothing is erased or programmed: programming flash a word at
// a time needs 2.7 V (3.6.2), and the brown-out reset follows at that level.
template <ports::RegisterBlock Pwr, ports::RegisterBlock Exti>
class VoltageDetector {
 public:
  constexpr VoltageDetector(Pwr& pwr, Exti& exti) : pwr_(pwr), exti_(exti) {}

  // The clock of the power controller must be enabled.
  void start() {
    namespace b = supply_bits;
    pwr_.write(b::kPwrCr,
               (pwr_.read(b::kPwrCr) & ~b::kCrLevelMask) | b::kCrLevel2V9 | b::kCrDetector);
    ports::set_bits(exti_, b::kExtiRtsr, b::kExtiDetector);  // rises when the supply falls
    ports::set_bits(exti_, b::kExtiImr, b::kExtiDetector);
  }

  bool is_low() const {
    return (pwr_.read(supply_bits::kPwrCsr) & supply_bits::kCsrBelowLevel) != 0;
  }

  void on_interrupt() {
    exti_.write(supply_bits::kExtiPr, supply_bits::kExtiDetector);  // written ones clear
    if (dips_ != UINT32_MAX) dips_ = dips_ + 1;
  }

  std::uint32_t dips() const { return dips_; }

 private:
  Pwr& pwr_;
  Exti& exti_;
  volatile std::uint32_t dips_ = 0;
};

// After this call a failure of the crystal raises NMI, and the chip uses its internal oscillator.
template <ports::RegisterBlock Rcc>
void start_clock_security(Rcc& rcc) {
  ports::set_bits(rcc, supply_bits::kRccCr, supply_bits::kCrClockSecurity);
}

// For the NMI handler: whether the crystal failed. Clears the flag.
template <ports::RegisterBlock Rcc>
bool take_clock_failure(Rcc& rcc) {
  if ((rcc.read(supply_bits::kRccCir) & supply_bits::kCirClockFailed) == 0) return false;
  ports::set_bits(rcc, supply_bits::kRccCir, supply_bits::kCirClockFailedClear);
  return true;
}

// Option bytes of the chip. Each protection of docs/flashing.md that they lack leaves its bit of
// 0x2040 sub 8 at 0.
struct OptionBytes {
  std::uint32_t word;

  bool has_brown_out_level_3() const { return (word & supply_bits::kOptcrBrownOutMask) == 0; }
  bool has_hardware_watchdog() const { return (word & supply_bits::kOptcrSoftwareWatchdog) == 0; }
  bool has_read_protection() const {
    return (word & supply_bits::kOptcrReadProtectionMask) != supply_bits::kOptcrReadProtectionNone;
  }
  bool has_protected_code() const { return (word & supply_bits::kOptcrCodeSectors) == 0; }
};

template <ports::RegisterBlock Flash>
OptionBytes read_option_bytes(const Flash& flash) {
  return {flash.read(supply_bits::kFlashOptcr)};
}

}  // namespace armtrue::stm32f405

#endif  // ARMTRUE_FIRMWARE_PORTS_STM32F405_SUPPLY_H_
