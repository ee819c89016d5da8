// The two watchdogs of the STM32F405. Neither can be disabled once it runs.
//
// The independent one (RM0090, section 21) has its own oscillator and runs from the first
// instruction on (early_start() in protection.cc), so that a start that hangs is reset as well.
//
// The window watchdog (section 22) supervises the joint path. It is fed every 25 ms of the
// program's clock and resets the chip if the next feeding comes within 12.5 ms or not within
// 49.9 ms of its own clock. This detects a runaway loop, a clock that stops or runs too fast, and a
// path that hangs. It is paused during requests that may take long while the arm is at rest.
#ifndef ARMTRUE_FIRMWARE_PORTS_STM32F405_WATCHDOGS_H_
#define ARMTRUE_FIRMWARE_PORTS_STM32F405_WATCHDOGS_H_

#include <cstdint>

#include "firmware/ports/common/register_block.h"

namespace armtrue::stm32f405 {

namespace iwdg_bits {
inline constexpr std::uint32_t kKr = 0x00;
inline constexpr std::uint32_t kPr = 0x04;
inline constexpr std::uint32_t kRlr = 0x08;
inline constexpr std::uint32_t kSr = 0x0C;
inline constexpr std::uint32_t kStart = 0xCCCC;
inline constexpr std::uint32_t kUnlock = 0x5555;
inline constexpr std::uint32_t kFeed = 0xAAAA;
inline constexpr std::uint32_t kBy256 = 6;  // of 32 kHz: eight milliseconds a step (table 107)
inline constexpr std::uint32_t kStepMs = 8;
}  // namespace iwdg_bits

template <ports::RegisterBlock Registers>
class IndependentWatchdog {
 public:
  static constexpr std::uint32_t kUsualMs = 1000;
  // Erasing a sector stalls the core for up to two seconds (DS8626, table 40).
  static constexpr std::uint32_t kEraseMs = 8000;

  explicit constexpr IndependentWatchdog(Registers& registers) : registers_(registers) {}

  void feed() { registers_.write(iwdg_bits::kKr, iwdg_bits::kFeed); }

  // Starts the watchdog if it does not run yet. Also feeds it.
  void set_timeout(std::uint32_t milliseconds) {
    constexpr std::uint32_t kPolls = 100'000;  // six periods of the slowest prescaler take 50 ms
    registers_.write(iwdg_bits::kKr, iwdg_bits::kStart);
    registers_.write(iwdg_bits::kKr, iwdg_bits::kUnlock);
    registers_.write(iwdg_bits::kPr, iwdg_bits::kBy256);
    registers_.write(iwdg_bits::kRlr, milliseconds / iwdg_bits::kStepMs);
    // The new values are valid once the status is clear; feeding loads them.
    ports::wait_for(registers_, iwdg_bits::kSr, 3U, 0, kPolls);
    feed();
  }

 private:
  Registers& registers_;
};

namespace wwdg_bits {
inline constexpr std::uint32_t kCr = 0x00;
inline constexpr std::uint32_t kCfr = 0x04;
inline constexpr std::uint32_t kFull = 0x7F;
inline constexpr std::uint32_t kActive = 1U << 7;
inline constexpr std::uint32_t kBy8 = 3U << 7;  // 42 MHz / 4096 / 8: 0.78 ms a step, reset at 0x3F
inline constexpr std::uint32_t kWindow = 0x6F;  // feeding before 16 steps have passed is too early
inline constexpr std::uint32_t kRccApb1Enr = 0x40;
inline constexpr std::uint32_t kRccApb1Watchdog = 1U << 11;
}  // namespace wwdg_bits

template <ports::RegisterBlock Registers, ports::RegisterBlock Rcc>
class WindowWatchdog {
 public:
  static constexpr std::uint32_t kFeedEveryUs = 25'000;

  constexpr WindowWatchdog(Registers& registers, Rcc& rcc) : registers_(registers), rcc_(rcc) {}

  void start(std::uint64_t now_us) {
    ports::set_bits(rcc_, wwdg_bits::kRccApb1Enr, wwdg_bits::kRccApb1Watchdog);
    registers_.write(wwdg_bits::kCfr, wwdg_bits::kBy8 | wwdg_bits::kWindow);
    registers_.write(wwdg_bits::kCr, wwdg_bits::kActive | wwdg_bits::kFull);
    fed_us_ = now_us;
    runs_ = true;
  }

  // Called in every loop with a sound joint path; feeds when it is time.
  void feed(std::uint64_t now_us) {
    if (!runs_ || now_us - fed_us_ < kFeedEveryUs) return;
    fed_us_ = now_us;
    registers_.write(wwdg_bits::kCr, wwdg_bits::kActive | wwdg_bits::kFull);
  }

  // Stops the watchdog's clock while a request may take long (signature check, programming and
  // erasing flash) and no joint is commanded. The independent watchdog supervises that time.
  void pause(std::uint64_t now_us) {
    paused_us_ = now_us;
    ports::clear_bits(rcc_, wwdg_bits::kRccApb1Enr, wwdg_bits::kRccApb1Watchdog);
  }
  // Keeps the time left until the next feeding: an earlier feeding would cause a reset.
  void resume(std::uint64_t now_us) {
    fed_us_ += now_us - paused_us_;
    ports::set_bits(rcc_, wwdg_bits::kRccApb1Enr, wwdg_bits::kRccApb1Watchdog);
  }

 private:
  Registers& registers_;
  Rcc& rcc_;
  std::uint64_t fed_us_ = 0;
  std::uint64_t paused_us_ = 0;
  bool runs_ = false;
};

}  // namespace armtrue::stm32f405

#endif  // ARMTRUE_FIRMWARE_PORTS_STM32F405_WATCHDOGS_H_
