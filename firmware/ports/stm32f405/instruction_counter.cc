#include "firmware/ports/arm/instruction_counter.h"

#include "firmware/ports/stm32f405/registers.h"

namespace armtrue::ports {

InstructionCounter::InstructionCounter() {
  constexpr std::uint32_t kTim2Clock = 1u << 0;  // RCC_APB1ENR
  stm32f405::rcc().apb1enr = stm32f405::rcc().apb1enr | kTim2Clock;
  stm32f405::tim2().psc = 0;
  stm32f405::tim2().arr = 0xFFFFFFFF;
  stm32f405::tim2().egr = 1;
  stm32f405::tim2().cr1 = 1;
  const std::uint32_t before = read();
  const std::uint32_t after = read();
  overhead_ = after - before;
}

// Not inlined, so that every reading costs what the constructor measured.
[[gnu::noinline]] std::uint32_t InstructionCounter::read() { return stm32f405::tim2().cnt; }

}  // namespace armtrue::ports
