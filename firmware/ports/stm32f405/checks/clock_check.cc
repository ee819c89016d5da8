// Test image: shows that the device's clock counts on while no interrupt is served, as during the
// erase of a flash sector. Prints what clock_us() counts in 40 ms with interrupts locked out, then
// in 40 ms with interrupts enabled. In the emulator an instruction takes one nanosecond (README.md
// of this port).
#include <cstdint>

#include "firmware/ports/arm/semihosting.h"
#include "firmware/ports/common/interrupt_lock.h"
#include "firmware/ports/stm32f405/system.h"

namespace {

using namespace armtrue;

constexpr std::uint32_t kWaitUs = 40'000;

// Two instructions per iteration (SUBS, BNE).
void wait() {
  std::uint32_t turns = kWaitUs * 1000 / 2;
  asm volatile("1: subs %0, %0, #1\n bne 1b" : "+r"(turns) : : "cc");
}

void print_waited_us() {
  const std::uint64_t begin_us = stm32f405::clock_us();
  wait();
  semihosting::print_unsigned(static_cast<std::uint32_t>(stm32f405::clock_us() - begin_us));
  semihosting::print("\n");
}

}  // namespace

int main() {
  stm32f405::start_clocks();
  {
    const ports::InterruptLock lock;
    print_waited_us();
  }
  print_waited_us();
  semihosting::exit(0);
}
