// Replaces the port's weak fault handler in test images: a fault ends the emulator with exit status
// 70. The weak handler would wait for a watchdog, which the emulator does not have.
#include "firmware/ports/arm/semihosting.h"

extern "C" [[noreturn]] void fault_handler() {
  armtrue::semihosting::print("fault: the processor took an exception that nothing handles\n");
  armtrue::semihosting::exit(70);
}
