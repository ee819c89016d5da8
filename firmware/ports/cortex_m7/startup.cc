// Vector table of a Cortex-M7 without interrupts: this port builds and runs the core of the
// firmware, not a product image.
#include "firmware/ports/arm/cortex_m_reset.h"

namespace {

[[gnu::section(".isr_vector"), gnu::used]] constinit const armtrue::ports::VectorTable<0>
    vector_table;

}  // namespace
