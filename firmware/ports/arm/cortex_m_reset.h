// Reset and vector table of any Cortex-M (Arm DDI 0403, B1.5).
#ifndef ARMTRUE_FIRMWARE_PORTS_ARM_CORTEX_M_RESET_H_
#define ARMTRUE_FIRMWARE_PORTS_ARM_CORTEX_M_RESET_H_

#include <cstddef>
#include <cstdint>

extern "C" {

// Top of the stack, from the linker script.
extern std::uint32_t _estack;

// Initialises memory, runs constructors and main().
[[noreturn]] void reset_handler();

// An exception that nothing handles; weak. The image stops feeding the watchdog and is reset by it.
// Test images replace this with one that ends the emulator.
[[noreturn]] void fault_handler();

// Where every exception and interrupt without a handler goes.
void default_handler();

// Weak.
void systick_handler();
}

namespace armtrue::ports {

inline constexpr std::size_t kExceptions = 16;

using Handler = void (*)();

// What stands at address 0 at reset: the stack, then exceptions 1 to 15, then the interrupts.
template <std::size_t kInterrupts>
struct VectorTable {
  std::uint32_t* stack = &_estack;
  Handler handler[kExceptions - 1 + kInterrupts];

  constexpr VectorTable() {
    for (Handler& each : handler) each = default_handler;
    handler[0] = reset_handler;
    handler[14] = systick_handler;
  }

  constexpr void set(std::size_t interrupt, Handler to) {
    handler[kExceptions - 1 + interrupt] = to;
  }
};

}  // namespace armtrue::ports

#endif  // ARMTRUE_FIRMWARE_PORTS_ARM_CORTEX_M_RESET_H_
