// The counter of this port under its own name.
#ifndef ARMTRUE_FIRMWARE_PORTS_STM32F405_INSTRUCTION_COUNTER_H_
#define ARMTRUE_FIRMWARE_PORTS_STM32F405_INSTRUCTION_COUNTER_H_

#include "firmware/ports/arm/instruction_counter.h"

namespace armtrue::stm32f405 {

using ports::InstructionCounter;

}  // namespace armtrue::stm32f405

#endif  // ARMTRUE_FIRMWARE_PORTS_STM32F405_INSTRUCTION_COUNTER_H_
