// Clock, watchdog and restart of the Cortex-R5F in the Zynq UltraScale+.
#ifndef ARMTRUE_FIRMWARE_PORTS_R5F_SYSTEM_H_
#define ARMTRUE_FIRMWARE_PORTS_R5F_SYSTEM_H_

#include <cstdint>

#include "firmware/ports/common/reset_log.h"

namespace armtrue::r5f {

// Whether this is an emulator, which does not model the clock controller of the low-power domain:
// its registers read as zero.
bool is_emulated();

// Starts the cycle counter of the performance monitor.
void start_clock();

// Microseconds since start_clock(). Must be called at least every four seconds: the counter has 32
// bits.
std::uint64_t clock_us();

void enable_interrupts();

// The causes of this start and of the earlier ones since power-on. The platform's firmware does not
// tell the cause of an external reset: such a start has kUnknown.
ports::ResetLog& reset_log();

// The watchdog of the low-power domain, from the first instruction on (UG1087, module SWDT). The
// platform's firmware decides what its expiry resets.
void start_watchdog();
void feed_watchdog();

// Starts the image again from its first instruction. Frames in the CAN controllers are lost.
[[noreturn]] void restart();

}  // namespace armtrue::r5f

#endif  // ARMTRUE_FIRMWARE_PORTS_R5F_SYSTEM_H_
