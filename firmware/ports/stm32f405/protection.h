// Protection of the STM32F405: a fault of the program or the clock ends in a reset with a cause.
#ifndef ARMTRUE_FIRMWARE_PORTS_STM32F405_PROTECTION_H_
#define ARMTRUE_FIRMWARE_PORTS_STM32F405_PROTECTION_H_

#include <cstdint>

#include "firmware/ports/common/reset_log.h"

namespace armtrue::stm32f405 {

// Records the cause of this start and turns the memory protection on: no execution from RAM, no
// access to the null page, to the memory below the stack or outside the used regions, no write to
// the image. Enables the handlers of memory, bus and usage faults. Call first in main(). Returns
// whether the memory protection is on.
bool start_protection();

// The causes of this start and of the earlier ones.
ports::ResetLog& reset_log();

// Records the cause and resets.
[[noreturn]] void restart(ports::ResetCause cause);

}  // namespace armtrue::stm32f405

#endif  // ARMTRUE_FIRMWARE_PORTS_STM32F405_PROTECTION_H_
