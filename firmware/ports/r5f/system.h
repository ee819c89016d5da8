// Clock, watchdog and restart of the Cortex-R5F in the Zynq UltraScale+.
#ifndef ARMTRUE_FIRMWARE_PORTS_R5F_SYSTEM_H_
#define ARMTRUE_FIRMWARE_PORTS_R5F_SYSTEM_H_

#include <cstdint>

#include "firmware/ports/common/reset_log.h"

namespace armtrue::r5f {

// Whether this is an emulator: the clock controller of the low-power domain is not modelled and
// reads as zero.
bool is_emulated();

// Starts the cycle counter of the performance monitor.
void start_clock();

// Microseconds since start_clock(). Must be called at least every four seconds: the counter has 32
// bits.
std::uint64_t clock_us();

void enable_interrupts();

// The causes of this start and of those before it, since power came. What reset the unit from
// outside the platform's firmware keeps to itself: such a start says kUnknown.
ports::ResetLog& reset_log();

// The watchdog of the low-power domain, from the first instruction on (UG1087, module SWDT). What
// its expiry resets is for the platform's firmware to say.
void start_watchdog();
void feed_watchdog();

// Starts the image again from its first instruction. What the bus controllers hold is lost.
[[noreturn]] void restart();

}  // namespace armtrue::r5f

#endif  // ARMTRUE_FIRMWARE_PORTS_R5F_SYSTEM_H_
