#include "firmware/ports/arm/cortex_m_reset.h"

extern "C" {

// From the linker script.
extern std::uint32_t _sidata, _sdata, _edata, _sbss, _ebss;
extern void (*__init_array_start[])();
extern void (*__init_array_end[])();

int main();

[[noreturn, gnu::weak]] void fault_handler() {
  for (;;) asm volatile("wfi");
}

void default_handler() { fault_handler(); }

[[gnu::weak]] void nmi_handler() { default_handler(); }

[[noreturn, gnu::weak]] void processor_fault_handler(const std::uint32_t*) { fault_handler(); }

// After a stack overflow the stack pointer is below the limit and no registers are saved there.
[[gnu::naked]] void processor_fault_entry() {
  asm volatile(
      "mov r0, sp\n"
      "ldr r1, =_stack_limit\n"
      "cmp r0, r1\n"
      "bhs 1f\n"
      "ldr r1, =_estack\n"
      "mov sp, r1\n"
      "movs r0, #0\n"
      "1: b processor_fault_handler\n"
      ".ltorg\n");
}

[[gnu::weak]] void early_start() {}

[[gnu::weak]] void systick_handler() { default_handler(); }

[[noreturn]] void reset_handler() {
  early_start();
  const std::uint32_t* source = &_sidata;
  for (std::uint32_t* to = &_sdata; to != &_edata; ++to) *to = *source++;
  for (std::uint32_t* to = &_sbss; to != &_ebss; ++to) *to = 0;
  for (auto constructor = __init_array_start; constructor != __init_array_end; ++constructor) {
    (*constructor)();
  }
  main();
  fault_handler();
}
}
