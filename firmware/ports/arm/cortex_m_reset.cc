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

[[gnu::weak]] void systick_handler() { default_handler(); }

[[noreturn]] void reset_handler() {
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
