// Reset and vector table of any Cortex-M (Arm DDI 0403, B1.5).
#ifndef ARMTRUE_FIRMWARE_PORTS_ARM_CORTEX_M_RESET_H_
#define ARMTRUE_FIRMWARE_PORTS_ARM_CORTEX_M_RESET_H_

#include <cstddef>
#include <cstdint>

extern "C" {

// Top of the stack, from the linker script.
extern std::uint32_t _estack;

// Calls early_start(), initialises memory, runs constructors and main().
[[noreturn]] void reset_handler();

// The first that runs, before any memory is initialised: it may use registers and the stack alone.
// Weak: does nothing.
void early_start();

// An exception that nothing handles; weak. The image stops feeding the watchdog and is reset by it.
// Test images replace this with one that ends the emulator.
[[noreturn]] void fault_handler();

// A fault of the processor. `frame`: what it saved of the interrupted code (Arm DDI 0403, B1.5.6),
// nullptr where the stack has no room for it. Weak: calls fault_handler().
[[noreturn]] void processor_fault_handler(const std::uint32_t* frame);

// Weak: a non-maskable interrupt is one that nothing handles.
void nmi_handler();

// Enters processor_fault_handler() on a stack that can be used.
void processor_fault_entry();

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
    handler[1] = nmi_handler;
    // HardFault, MemManage, BusFault, UsageFault.
    for (std::size_t i = 2; i <= 5; ++i) handler[i] = processor_fault_entry;
    handler[14] = systick_handler;
  }

  constexpr void set(std::size_t interrupt, Handler to) {
    handler[kExceptions - 1 + interrupt] = to;
  }
};

}  // namespace armtrue::ports

#endif  // ARMTRUE_FIRMWARE_PORTS_ARM_CORTEX_M_RESET_H_
