// Test image: shows on a Cortex-R5F that vectors, interrupt entry and the GIC driver work together.
// QEMU before 10.2 gives this core no interrupt controller in the Zynq UltraScale+. QEMU's RealView
// board takes the same core and has the same kind of controller, and a timer (SP804) to raise
// interrupts. Ends with status 0 if kTicks interrupts during a computation changed no register.
#include <cstdint>

#include "firmware/ports/arm/semihosting.h"
#include "firmware/ports/common/interrupt_lock.h"
#include "firmware/ports/common/register_block.h"
#include "firmware/ports/r5f/gic.h"
#include "firmware/ports/r5f/system.h"

namespace {

using namespace armtrue;
using ports::MappedRegisters;

// RealView Platform Baseboard for Cortex-A8 (Arm DUI 0417).
MappedRegisters interface(0x1E000000);
MappedRegisters distributor(0x1E001000);
MappedRegisters timer(0x10011000);
constexpr std::uint32_t kTimerInterrupt = 36;

// SP804 (Arm DDI 0271).
constexpr std::uint32_t kLoad = 0x00;
constexpr std::uint32_t kControl = 0x08;
constexpr std::uint32_t kClear = 0x0C;
constexpr std::uint32_t kPeriodic32BitWithInterrupt = 0xE2;

constexpr std::uint32_t kTicks = 100;

r5f::Gic<MappedRegisters> interrupts(distributor, interface);
volatile std::uint32_t ticks = 0;
volatile std::uint32_t others = 0;
volatile std::uint32_t result = 0;  // keeps the compiler from removing the computation

// A computation that interrupts must not disturb: it uses all registers, and one lost bit changes
// its result.
std::uint32_t hash(std::uint32_t rounds) {
  std::uint32_t a = 1, b = 2, c = 3, d = 4, e = 5, f = 6, g = 7, h = 8;
  for (std::uint32_t i = 0; i < rounds; ++i) {
    a = a * 1664525U + b;
    b ^= a >> 13;
    c += b * 69069U;
    d ^= c << 7;
    e = e * 22695477U + d;
    f ^= e >> 11;
    g += f;
    h = h * 214013U + (g ^ i);
  }
  return a ^ b ^ c ^ d ^ e ^ f ^ g ^ h;
}

}  // namespace

extern "C" void irq_handler() {
  interrupts.serve([](std::uint32_t number) {
    if (number == kTimerInterrupt) {
      timer.write(kClear, 1);
      ticks = ticks + 1;
    } else {
      others = others + 1;
    }
  });
}

int main() {
  constexpr std::uint32_t kRounds = 2000;
  const std::uint32_t expected = hash(kRounds);
  if (!interrupts.is_present()) semihosting::exit(1);
  interrupts.start();
  interrupts.enable(kTimerInterrupt);
  timer.write(kLoad, 200);
  timer.write(kControl, kPeriodic32BitWithInterrupt);
  r5f::enable_interrupts();
  while (ticks < kTicks) {
    if (hash(kRounds) != expected) semihosting::exit(2);
  }
  // No interrupt is taken while they are locked out; afterwards they are taken again.
  {
    const ports::InterruptLock lock;
    const std::uint32_t before = ticks;
    result = hash(100 * kRounds);
    if (ticks != before) semihosting::exit(3);
  }
  result = hash(100 * kRounds);
  semihosting::exit(others == 0 && ticks > kTicks ? 0 : 4);
}
