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

// Runs first, before any memory is initialised: may use only registers and the stack. Weak: does
// nothing.
void early_start();

// Called for an exception without a handler. Weak: loops for ever, so that the watchdog is not fed
// and resets the image. Test images replace it with a function that ends the emulator.
[[noreturn]] void fault_handler();

// A fault of the processor. `frame`: registers of the interrupted code that the processor saved
// (Arm DDI 0403, B1.5.6), nullptr if the stack had no room for them. Weak: calls fault_handler().
[[noreturn]] void processor_fault_handler(const std::uint32_t* frame);

// Non-maskable interrupt. Weak: calls default_handler().
void nmi_handler();

// Calls processor_fault_handler(). After a stack overflow it first moves the stack pointer to the
// top.
void processor_fault_entry();

// Entry of every exception and interrupt without a handler: calls fault_handler().
void default_handler();

// Weak: calls default_handler().
void systick_handler();
}

namespace armtrue::ports {

inline constexpr std::size_t kExceptions = 16;

using Handler = void (*)();

// At address 0 at reset: initial stack pointer, exceptions 1 to 15, interrupts.
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
