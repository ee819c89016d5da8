// The compensator on the STM32F405: inline between CAN1 (controller) and CAN2 (drives), or between
// two serial ports in SLCAN if there is no CAN (an emulator) or no crystal, or if the jumper BOOT1
// is set.
#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <new>
#include <span>

#include "firmware/ports/common/device.h"
#include "firmware/ports/common/slcan_port.h"
#include "firmware/ports/common/slot_parameters.h"
#include "firmware/ports/identity.h"
#include "firmware/ports/stm32f405/bxcan.h"
#include "firmware/ports/stm32f405/flash_driver.h"
#include "firmware/ports/stm32f405/guarded_flash.h"
#include "firmware/ports/stm32f405/protection.h"
#include "firmware/ports/stm32f405/supply.h"
#include "firmware/ports/stm32f405/system.h"
#include "firmware/ports/stm32f405/usart.h"
#include "firmware/ports/stm32f405/watchdogs.h"
#include "firmware/storage/ram_flash.h"

namespace {

using namespace armtrue;
using namespace armtrue::stm32f405;
using ports::MappedRegisters;

constexpr std::uint32_t kSerialBitRate = 2'000'000;
constexpr std::uint32_t kParameterSector = 8;  // and 9
constexpr std::uint32_t kTableSector = 10;     // and 11

// Interrupt numbers (RM0090, table 62).
constexpr std::uint32_t kCanInterrupts[] = {19, 20, 22, 63, 64, 66};
constexpr std::uint32_t kSerialInterrupts[] = {37, 38};
constexpr std::uint32_t kVoltageInterrupt = 1;

MappedRegisters can1_registers(0x40006400);
MappedRegisters can2_registers(0x40006800);
MappedRegisters flash_registers(0x40023C00);
MappedRegisters usart1_registers(0x40011000);
MappedRegisters usart2_registers(0x40004400);
MappedRegisters rcc_registers(0x40023800);
MappedRegisters pwr_registers(0x40007000);
MappedRegisters exti_registers(0x40013C00);
MappedRegisters iwdg_registers(0x40003000);
MappedRegisters wwdg_registers(0x40002C00);
MappedFlashArray flash_array;

using Independent = IndependentWatchdog<MappedRegisters>;
using Window = WindowWatchdog<MappedRegisters, MappedRegisters>;
using Detector = VoltageDetector<MappedRegisters, MappedRegisters>;
Independent watchdog(iwdg_registers);
Window window_watchdog(wwdg_registers, rcc_registers);
Detector voltage(pwr_registers, exti_registers);

// The device uses CAN or serial lines, never both: their queues share one memory.
struct CanLines {
  BxCan<MappedRegisters> first{can1_registers};
  BxCan<MappedRegisters> second{can2_registers};
};
struct SerialLines {
  Usart<MappedRegisters> first{usart1_registers};
  Usart<MappedRegisters> second{usart2_registers};
  ports::SlcanPort first_port{first};
  ports::SlcanPort second_port{second};
};
alignas(8) std::byte line_memory[std::max(sizeof(CanLines), sizeof(SerialLines))];
canopen::PortHealth health;
CanLines* can = nullptr;        // set before the interrupts that use it are enabled
SerialLines* serial = nullptr;  // likewise

using SectorFlash = FlashDriver<MappedRegisters, MappedFlashArray>;
using SlotFlash = GuardedFlash<SectorFlash, Independent, Detector>;
SectorFlash table_sectors(flash_registers, flash_array, kTableSector);
SectorFlash parameter_sectors(flash_registers, flash_array, kParameterSector);
SlotFlash table_flash(table_sectors, watchdog, voltage);
SlotFlash parameter_flash(parameter_sectors, watchdog, voltage);

// Beyond the SRAM of the chip. The emulated board has memory there that survives a restart.
constexpr std::uintptr_t kEmulatedMemory = 0x20020000;
constexpr std::size_t kEmulatedTables = 2 * (kMaxImageLength + storage::kHeaderBytes);
constexpr std::size_t kEmulatedParameters = 8 * 1024;
storage::RamFlash emulated_tables(std::span(reinterpret_cast<std::uint8_t*>(kEmulatedMemory),
                                            kEmulatedTables));
storage::RamFlash emulated_parameters(std::span(
    reinterpret_cast<std::uint8_t*>(kEmulatedMemory + kEmulatedTables), kEmulatedParameters));

// Checking a signature takes longer than the watchdog's window, and so does programming a table.
void note_long_request(bool begins) {
  begins ? window_watchdog.pause(clock_us()) : window_watchdog.resume(clock_us());
}

bool start_can() {
  constexpr ports::BitTiming kTiming = ports::bit_timing(kApb1Hz, ports::kBitRate);
  static_assert(kTiming.prescaler != 0, "ARMTRUE_BIT_RATE does not divide 42 MHz");
  accept_all_frames(can1_registers);
  can = new (line_memory) CanLines;
  if (!can->first.start(kTiming) || !can->second.start(kTiming)) return false;
  for (const std::uint32_t interrupt : kCanInterrupts) enable_interrupt(interrupt);
  return true;
}

void start_serial() {
  serial = new (line_memory) SerialLines;
  serial->first.start(kApb2Hz, kSerialBitRate);
  serial->second.start(kApb1Hz, kSerialBitRate);
  for (const std::uint32_t interrupt : kSerialInterrupts) enable_interrupt(interrupt);
}

}  // namespace

extern "C" {
void can1_tx_handler() {
  can->first.on_transmit_interrupt();
  wake();
}
void can1_rx0_handler() {
  can->first.on_receive_interrupt();
  wake();
}
void can1_sce_handler() {
  can->first.on_status_interrupt();
  wake();
}
void can2_tx_handler() {
  can->second.on_transmit_interrupt();
  wake();
}
void can2_rx0_handler() {
  can->second.on_receive_interrupt();
  wake();
}
void can2_sce_handler() {
  can->second.on_status_interrupt();
  wake();
}
void usart1_handler() {
  serial->first.on_interrupt();
  wake();
}
void usart2_handler() {
  serial->second.on_interrupt();
  wake();
}
void voltage_handler() {
  voltage.on_interrupt();
  health.supply_dips = voltage.dips();
}
}

namespace {

// Separate from main(), so that its stack frame is free again while the device runs.
[[gnu::noinline]] ports::Device& make_device() {
  const ClockSource source = start_clocks();
  if (source == ClockSource::kCrystal) {
    start_clock_security(rcc_registers);
    health.protection |= canopen::kClockSecurity;
  }
  start_pins();
  voltage.start();
  enable_interrupt(kVoltageInterrupt);
  const bool has_can = source == ClockSource::kCrystal && !serial_is_requested() && start_can();
  if (!has_can) start_serial();

  const bool has_flash = table_sectors.is_present();
  if (!has_flash) {
    emulated_tables.start();
    emulated_parameters.start();
  }
  storage::Flash& tables = has_flash ? static_cast<storage::Flash&>(table_flash) : emulated_tables;
  storage::Flash& settings =
      has_flash ? static_cast<storage::Flash&>(parameter_flash) : emulated_parameters;
  static ports::SlotParameters parameters(settings);
  parameters.start();

  canopen::CanPort& upstream =
      has_can ? static_cast<canopen::CanPort&>(can->first) : serial->first_port;
  canopen::CanPort& downstream =
      has_can ? static_cast<canopen::CanPort&>(can->second) : serial->second_port;
  static ports::Device device(ports::kSettings, {upstream, &downstream, tables, parameters,
                                                 &clock_us, &health, &note_long_request});
  return device;
}

void note_health(bool has_memory_protection) {
  const ports::ResetLog& log = reset_log();
  const OptionBytes option_bytes = read_option_bytes(flash_registers);
  health = {.reset_cause = static_cast<std::uint8_t>(log.cause()),
            .starts = log.resets(),
            .history = log.history(),
            .fault_instruction = log.fault().instruction,
            .fault_status = log.fault().status,
            .fault_address = log.fault().address,
            .option_bytes = option_bytes.word,
            .protection = canopen::kVoltageDetector | canopen::kWindowWatchdog};
  const auto note = [](bool is_in_force, std::uint32_t bit) {
    if (is_in_force) health.protection |= bit;
  };
  note(has_memory_protection, canopen::kMemoryProtection);
  note(option_bytes.has_brown_out_level_3(), canopen::kBrownOutLevel3);
  note(option_bytes.has_hardware_watchdog(), canopen::kHardwareWatchdog);
  note(option_bytes.has_read_protection(), canopen::kReadProtection);
  note(option_bytes.has_protected_code(), canopen::kCodeWriteProtection);
}

}  // namespace

int main() {
  watchdog.set_timeout(Independent::kUsualMs);  // already running since the first instruction
  note_health(start_protection());
  ports::Device& device = make_device();
  device.start();
  watchdog.feed();
  window_watchdog.start(clock_us());
  for (bool goes_on = true; goes_on; sleep()) {
    bool is_sound = false;
    goes_on = device.turn([&is_sound] { is_sound = true; });
    if (is_sound) {
      watchdog.feed();
      window_watchdog.feed(clock_us());
    }
    show_health(is_sound);
  }
  restart(ports::ResetCause::kNmt);
}
