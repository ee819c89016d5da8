// The compensator on a Cortex-R5F of the Zynq UltraScale+: inline between CAN0 (controller) and
// CAN1 (drives).
#include <array>
#include <cstdint>
#include <span>

#include "firmware/core/fixed/counter.h"
#include "firmware/core/table/limits.h"
#include "firmware/ports/common/device.h"
#include "firmware/ports/common/register_block.h"
#include "firmware/ports/common/slot_parameters.h"
#include "firmware/ports/identity.h"
#include "firmware/ports/r5f/gic.h"
#include "firmware/ports/r5f/system.h"
#include "firmware/ports/r5f/zynqmp_can.h"
#include "firmware/storage/ram_flash.h"

// Calls of the CAN controllers' handlers since the image started, by interrupt and by polling. A
// debugger or the emulator's monitor reads it by this name (tests/qemu.py).
struct WaysIn {
  std::uint32_t can0_interrupts;
  std::uint32_t can1_interrupts;
  std::uint32_t polls;
};
extern "C" {
[[gnu::used]] WaysIn armtrue_ways_in;
}

namespace {

using namespace armtrue;
using namespace armtrue::r5f;
using ports::MappedRegisters;

// Shared peripheral interrupts (UG1085, table 13-1).
constexpr std::uint32_t kCan0Interrupt = 55;
constexpr std::uint32_t kCan1Interrupt = 56;
constexpr std::uint32_t kCanHz = 100'000'000;  // CAN_REF in the usual configuration
constexpr std::uint64_t kPollUs = 100;

MappedRegisters can0_registers(0xFF060000);
MappedRegisters can1_registers(0xFF070000);
MappedRegisters gic_distributor(0xF9000000);
MappedRegisters gic_interface(0xF9001000);
MappedRegisters uart_registers(0xFF000000);

Gic<MappedRegisters> interrupts(gic_distributor, gic_interface);

const FifoLayout fifo_layout = is_emulated() ? FifoLayout::kEmulated : FifoLayout::kHardware;
ZynqMpCan<MappedRegisters> can0(can0_registers, fifo_layout);
ZynqMpCan<MappedRegisters> can1(can1_registers, fifo_layout);

// Slots in RAM, because the unit has no flash of its own. They survive a restart of the image, but
// not the loss of power.
constexpr std::size_t kTableSlots = 2 * (kMaxImageLength + storage::kHeaderBytes);
constexpr std::size_t kParameterSlots = 8 * 1024;
[[gnu::section(".noinit")]] std::array<std::uint8_t, kTableSlots> table_memory;
[[gnu::section(".noinit")]] std::array<std::uint8_t, kParameterSlots> parameter_memory;
storage::RamFlash table_flash(table_memory);
storage::RamFlash parameter_flash(parameter_memory);

// Cadence UART (UG1087, module UART), with the settings that the loader made.
void print(const char* text) {
  constexpr std::uint32_t kControl = 0x00;
  constexpr std::uint32_t kStatus = 0x2C;
  constexpr std::uint32_t kFifo = 0x30;
  constexpr std::uint32_t kTransmitterOn = 1U << 4;
  constexpr std::uint32_t kTransmitterOff = 1U << 5;
  constexpr std::uint32_t kFull = 1U << 4;
  constexpr std::uint32_t kPolls = 100000;
  ports::clear_bits(uart_registers, kControl, kTransmitterOff);
  ports::set_bits(uart_registers, kControl, kTransmitterOn);
  for (; *text != '\0'; ++text) {
    if (!ports::wait_for(uart_registers, kStatus, kFull, 0, kPolls)) return;
    uart_registers.write(kFifo, static_cast<std::uint8_t>(*text));
  }
}

// Without an interrupt controller (QEMU before 10.2 connects none to this core) the same handlers
// are polled. Polls are kPollUs apart, because every device access stops the whole emulator.
void poll_controllers() {
  const std::uint64_t begin = clock_us();
  while (clock_us() - begin < kPollUs) {
  }
  count(armtrue_ways_in.polls);
  can0.on_interrupt();
  can1.on_interrupt();
}

}  // namespace

extern "C" void irq_handler() {
  interrupts.serve([](std::uint32_t number) {
    if (number == kCan0Interrupt) {
      count(armtrue_ways_in.can0_interrupts);
      can0.on_interrupt();
    } else if (number == kCan1Interrupt) {
      count(armtrue_ways_in.can1_interrupts);
      can1.on_interrupt();
    }
  });
}

int main() {
  constexpr ports::BitTiming kTiming = ports::bit_timing(kCanHz, ports::kBitRate);
  static_assert(kTiming.prescaler != 0, "ARMTRUE_BIT_RATE does not divide 100 MHz");
  reset_log().start(ports::ResetCause::kUnknown);
  start_clock();
  if (!can0.start(kTiming) || !can1.start(kTiming)) {
    print("armtrue: a CAN controller does not answer its reset\r\n");
    return 1;
  }
  table_flash.start();
  parameter_flash.start();
  static ports::SlotParameters parameters(parameter_flash);
  parameters.start();
  static ports::Device device(ports::kSettings, {can0, &can1, table_flash, parameters, &clock_us});
  device.start();

  feed_watchdog();
  const bool has_interrupts = interrupts.is_present();
  if (has_interrupts) {
    interrupts.start();
    interrupts.enable(kCan0Interrupt);
    interrupts.enable(kCan1Interrupt);
    enable_interrupts();
  }
  print(has_interrupts ? "armtrue: ready, by interrupt\r\n" : "armtrue: ready, polling\r\n");
  while (device.turn(feed_watchdog)) {
    if (!has_interrupts) poll_controllers();
  }
  restart();
}
