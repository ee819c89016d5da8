// What the STM32F405 does so that a fault of the program or the clock ends in a reset with a cause.
#ifndef ARMTRUE_FIRMWARE_PORTS_STM32F405_PROTECTION_H_
#define ARMTRUE_FIRMWARE_PORTS_STM32F405_PROTECTION_H_

#include <cstdint>

#include "firmware/ports/common/reset_log.h"

namespace armtrue::stm32f405 {

// Takes the cause of this start and turns the memory protection on: no execution from RAM, no
// access to the null page, to the memory below the stack or to what is nobody's, no write to the
// image. Faults of memory, bus and usage get handlers of their own. Call first in main().
// Returns whether the memory protection is on.
bool start_protection();

// The causes of this start and of those before it.
ports::ResetLog& reset_log();

// Notes the cause and resets.
[[noreturn]] void restart(ports::ResetCause cause);

}  // namespace armtrue::stm32f405

#endif  // ARMTRUE_FIRMWARE_PORTS_STM32F405_PROTECTION_H_
