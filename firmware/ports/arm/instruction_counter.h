// Counts time in the finest unit that the machine has; each port implements it.
//
// STM32F405: timer TIM2. In QEMU (netduinoplus2) it counts nanoseconds of virtual time and
// `-icount shift=0` makes every instruction take one, so a difference of two readings is exactly
// the number of instructions between them, the same on every run. On the board TIM2 runs at 84 MHz:
// one tick is two core cycles at 168 MHz.
//
// Cortex-M7 (QEMU's mps2-an500): SysTick at 25 MHz; readings are instructions in steps of forty.
#ifndef ARMTRUE_FIRMWARE_PORTS_ARM_INSTRUCTION_COUNTER_H_
#define ARMTRUE_FIRMWARE_PORTS_ARM_INSTRUCTION_COUNTER_H_

#include <cstdint>

namespace armtrue::ports {

class InstructionCounter {
 public:
  // Starts the timer and measures what one reading costs.
  InstructionCounter();

  // Ticks since start, modulo 2^32.
  static std::uint32_t read();

  // Ticks between two readings, without the cost of reading.
  std::uint32_t between(std::uint32_t before, std::uint32_t after) const {
    return after - before - overhead_;
  }

 private:
  std::uint32_t overhead_ = 0;
};

}  // namespace armtrue::ports

#endif  // ARMTRUE_FIRMWARE_PORTS_ARM_INSTRUCTION_COUNTER_H_
