#include "firmware/ports/r5f/system.h"

#include "firmware/ports/common/register_block.h"

extern "C" [[noreturn]] void reset_handler();

namespace armtrue::r5f {
namespace {

// Survives a restart of the image.
[[gnu::section(".noinit")]] ports::ResetRecord reset_record;
constinit ports::ResetLog log(reset_record);

// Counter cycles per microsecond: 500 MHz in the usual configuration; QEMU counts nanoseconds.
constexpr std::uint32_t kHardwareCycles = 500;
constexpr std::uint32_t kEmulatedCycles = 1000;

std::uint32_t cycles_per_us = kHardwareCycles;
std::uint32_t last_cycles = 0;
std::uint64_t microseconds = 0;
constexpr std::uintptr_t kWatchdog = 0xFF150000;

std::uint32_t cycles() {
  std::uint32_t value;
  asm volatile("mrc p15, 0, %0, c9, c13, 0" : "=r"(value));
  return value;
}

}  // namespace

ports::ResetLog& reset_log() { return log; }

bool is_emulated() {
  constexpr std::uintptr_t kClockController = 0xFF5E0000;
  constexpr std::uint32_t kIoPllControl = 0x20;
  return ports::MappedRegisters(kClockController).read(kIoPllControl) == 0;
}

void start_clock() {
  constexpr std::uint32_t kEnableAndReset = 1U | 1U << 2;
  constexpr std::uint32_t kCycleCounter = 1U << 31;
  asm volatile("mcr p15, 0, %0, c9, c12, 0" : : "r"(kEnableAndReset));
  asm volatile("mcr p15, 0, %0, c9, c12, 1" : : "r"(kCycleCounter));
  cycles_per_us = is_emulated() ? kEmulatedCycles : kHardwareCycles;
  last_cycles = cycles();
}

std::uint64_t clock_us() {
  const std::uint32_t whole = (cycles() - last_cycles) / cycles_per_us;
  last_cycles += whole * cycles_per_us;
  microseconds += whole;
  return microseconds;
}

void enable_interrupts() { asm volatile("cpsie i" : : : "memory"); }

void start_watchdog() {
  constexpr std::uint32_t kMode = 0x00;
  constexpr std::uint32_t kControl = 0x04;
  constexpr std::uint32_t kModeKey = 0xABCU << 12;
  constexpr std::uint32_t kControlKey = 0x248U << 14;
  constexpr std::uint32_t kEnableReset = 3;
  // Counts down from (2 + 1) * 4096 at the bus clock of 100 MHz divided by 4096: 0.5 s.
  constexpr std::uint32_t kReload = 2U << 2;
  constexpr std::uint32_t kBy4096 = 3;
  ports::MappedRegisters watchdog(kWatchdog);
  watchdog.write(kMode, kModeKey);
  watchdog.write(kControl, kControlKey | kReload | kBy4096);
  feed_watchdog();
  watchdog.write(kMode, kModeKey | kEnableReset);
}

void feed_watchdog() {
  constexpr std::uint32_t kRestart = 0x08;
  constexpr std::uint32_t kRestartKey = 0x1999;
  ports::MappedRegisters(kWatchdog).write(kRestart, kRestartKey);
}

void restart() {
  log.note(ports::ResetCause::kNmt);
  asm volatile("cpsid if" : : : "memory");
  reset_handler();
}

}  // namespace armtrue::r5f

// Loops until the watchdog expires.
extern "C" [[noreturn, gnu::weak]] void fault_handler() {
  armtrue::r5f::reset_log().note(armtrue::ports::ResetCause::kFault);
  for (;;) asm volatile("wfi");
}

// Runs first, before memory is initialised.
extern "C" void early_start() { armtrue::r5f::start_watchdog(); }
