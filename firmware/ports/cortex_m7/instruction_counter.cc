#include "firmware/ports/arm/instruction_counter.h"

#include "firmware/ports/common/register_block.h"

namespace armtrue::ports {
namespace {

// SysTick (Arm DDI 0403, B3.3): 24 bits, downwards.
MappedRegisters systick(0xE000E010);
constexpr std::uint32_t kControl = 0x0;
constexpr std::uint32_t kReload = 0x4;
constexpr std::uint32_t kValue = 0x8;
constexpr std::uint32_t kRange = 1U << 24;
constexpr std::uint32_t kInstructionsPerTick = 40;

}  // namespace

InstructionCounter::InstructionCounter() {
  constexpr std::uint32_t kRunOnCoreClock = 5;
  systick.write(kReload, kRange - 1);
  systick.write(kValue, 0);
  systick.write(kControl, kRunOnCoreClock);
  const std::uint32_t before = read();
  overhead_ = read() - before;
}

// Valid for 0.67 s, after which the counter wraps around.
[[gnu::noinline]] std::uint32_t InstructionCounter::read() {
  return (kRange - systick.read(kValue)) * kInstructionsPerTick;
}

}  // namespace armtrue::ports
