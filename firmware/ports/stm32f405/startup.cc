// Vector table of the STM32F405 (ST RM0090, table 62).
#include "firmware/ports/arm/cortex_m_reset.h"

extern "C" {
// Weak: an image defines the handlers that it uses.
[[gnu::weak]] void voltage_handler() { default_handler(); }
[[gnu::weak]] void can1_tx_handler() { default_handler(); }
[[gnu::weak]] void can1_rx0_handler() { default_handler(); }
[[gnu::weak]] void can1_sce_handler() { default_handler(); }
[[gnu::weak]] void usart1_handler() { default_handler(); }
[[gnu::weak]] void usart2_handler() { default_handler(); }
[[gnu::weak]] void can2_tx_handler() { default_handler(); }
[[gnu::weak]] void can2_rx0_handler() { default_handler(); }
[[gnu::weak]] void can2_sce_handler() { default_handler(); }
}

namespace {

constexpr armtrue::ports::VectorTable<82> make_vector_table() {
  armtrue::ports::VectorTable<82> table;
  table.set(1, voltage_handler);
  table.set(19, can1_tx_handler);
  table.set(20, can1_rx0_handler);
  table.set(22, can1_sce_handler);
  table.set(37, usart1_handler);
  table.set(38, usart2_handler);
  table.set(63, can2_tx_handler);
  table.set(64, can2_rx0_handler);
  table.set(66, can2_sce_handler);
  return table;
}

[[gnu::section(".isr_vector"), gnu::used]] constinit const armtrue::ports::VectorTable<82>
    vector_table = make_vector_table();

}  // namespace
