// The device's time: the timer TIM2, which counts microseconds in 32 bits (ST RM0090, section 18).
//
// The timer counts in hardware, independent of the core. A count of millisecond interrupts would
// lose the one to two seconds for which the erase of a flash sector stalls the core.
#ifndef ARMTRUE_FIRMWARE_PORTS_STM32F405_FREE_RUNNING_CLOCK_H_
#define ARMTRUE_FIRMWARE_PORTS_STM32F405_FREE_RUNNING_CLOCK_H_

#include <cstdint>

#include "firmware/ports/common/register_block.h"

namespace armtrue::stm32f405 {

namespace timer_bits {
inline constexpr std::uint32_t kCr1 = 0x00;
inline constexpr std::uint32_t kEgr = 0x14;
inline constexpr std::uint32_t kCnt = 0x24;
inline constexpr std::uint32_t kPsc = 0x28;
inline constexpr std::uint32_t kArr = 0x2C;
inline constexpr std::uint32_t kCr1Enable = 1U << 0;
inline constexpr std::uint32_t kEgrUpdate = 1U << 0;  // loads the prescaler, clears the counter
}  // namespace timer_bits

template <ports::RegisterBlock Timer>
class FreeRunningClock {
 public:
  explicit constexpr FreeRunningClock(Timer& timer) : timer_(timer) {}

  // `timer_hz`: clock of the timer, a whole number of megahertz. It must be enabled.
  void start(std::uint32_t timer_hz) {
    namespace b = timer_bits;
    timer_.write(b::kPsc, timer_hz / 1'000'000 - 1);
    timer_.write(b::kArr, UINT32_MAX);
    timer_.write(b::kEgr, b::kEgrUpdate);
    timer_.write(b::kCr1, b::kCr1Enable);
  }

  // Microseconds since start(), never decreasing. Two calls must be less than 71 minutes apart, or
  // an overflow of the counter is missed. Must not be called from interrupts.
  std::uint64_t now_us() {
    const std::uint32_t count = timer_.read(timer_bits::kCnt);
    now_us_ += count - counted_;
    counted_ = count;
    return now_us_;
  }

 private:
  Timer& timer_;
  std::uint32_t counted_ = 0;
  std::uint64_t now_us_ = 0;
};

}  // namespace armtrue::stm32f405

#endif  // ARMTRUE_FIRMWARE_PORTS_STM32F405_FREE_RUNNING_CLOCK_H_
