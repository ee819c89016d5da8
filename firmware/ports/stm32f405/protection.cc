#include "firmware/ports/stm32f405/protection.h"

#include <array>

#include "firmware/ports/arm/cortex_m_reset.h"
#include "firmware/ports/arm/mpu.h"
#include "firmware/ports/common/register_block.h"
#include "firmware/ports/stm32f405/supply.h"
#include "firmware/ports/stm32f405/watchdogs.h"

// From the linker script.
extern "C" std::uint32_t _stack_limit;

namespace armtrue::stm32f405 {
namespace {

using ports::Access;
using ports::MappedRegisters;
using ports::Memory;
using ports::MpuRegion;
using ports::ResetCause;

constexpr std::uint32_t kStackGuardBytes = 256;  // _stack_guard_size of the linker script

// System control block (PM0214, 4.4), offsets from 0xE000ED00.
constexpr std::uintptr_t kSystemControl = 0xE000ED00;
constexpr std::uint32_t kVtor = 0x08;
constexpr std::uint32_t kAircr = 0x0C;
constexpr std::uint32_t kShcsr = 0x24;
constexpr std::uint32_t kCfsr = 0x28;
constexpr std::uint32_t kMmfar = 0x34;
constexpr std::uint32_t kBfar = 0x38;
constexpr std::uint32_t kAircrReset = 0x05FA0004;
constexpr std::uint32_t kShcsrFaults = 7U << 16;  // memory, bus, usage
constexpr std::uint32_t kCfsrMemory = 0xFF;       // memory management
constexpr std::uint32_t kCfsrBusAddress = 1U << 15;

// Survives a reset, not the loss of power.
[[gnu::section(".noinit")]] ports::ResetRecord reset_record;
constinit ports::ResetLog log(reset_record);

// RM0090, 2.3. Addresses outside these regions cannot be accessed.
constexpr std::array kFixedRegions = {
    MpuRegion{0x08000000, 1U << 20, Access::kReadOnly, Memory::kNormal, true},
    MpuRegion{0x08080000, 1U << 19, Access::kReadWrite},  // slots of parameters and tables
    // SRAM; the emulated board has more of it, for its slots.
    MpuRegion{0x20000000, 1U << 18, Access::kReadWrite},
    MpuRegion{0x40000000, 1U << 29, Access::kReadWrite, Memory::kDevice},
};

}  // namespace

ports::ResetLog& reset_log() { return log; }

bool start_protection() {
  MappedRegisters rcc(0x40023800);
  log.start(take_reset_cause(rcc));

  MappedRegisters system(kSystemControl);
  // Vectors are read at the image's own address, because its alias in the null page is not
  // accessible.
  system.write(kVtor, kFixedRegions[0].base);
  ports::set_bits(system, kShcsr, kShcsrFaults);

  std::array<MpuRegion, kFixedRegions.size() + 1> regions = {
      kFixedRegions[0], kFixedRegions[1], kFixedRegions[2], kFixedRegions[3], {}};
  regions.back() = {reinterpret_cast<std::uintptr_t>(&_stack_limit) - kStackGuardBytes,
                    kStackGuardBytes, Access::kNone};
  MappedRegisters unit(0xE000ED90);
  const bool is_on = ports::start_mpu(unit, regions);
  asm volatile("dsb\n isb" : : : "memory");
  return is_on;
}

void restart(ResetCause cause) {
  log.note(cause);
  asm volatile("dsb" : : : "memory");
  MappedRegisters(kSystemControl).write(kAircr, kAircrReset);
  for (;;) {
  }
}

}  // namespace armtrue::stm32f405

extern "C" {

// Starts the independent watchdog, with its timeout after reset of 0.5 s, before any code can hang.
void early_start() {
  using namespace armtrue;
  ports::MappedRegisters(0x40003000).write(stm32f405::iwdg_bits::kKr, stm32f405::iwdg_bits::kStart);
}

// Records the cause and the place of a fault and resets: after a fault no other state is trusted.
[[noreturn]] void processor_fault_handler(const std::uint32_t* frame) {
  using namespace armtrue;
  using namespace armtrue::stm32f405;
  constexpr std::uint32_t kSavedPc = 6;  // r0 to r3, r12, lr, pc (Arm DDI 0403, B1.5.6)
  const ports::MappedRegisters system(kSystemControl);
  const std::uint32_t status = system.read(kCfsr);
  const ports::FaultPlace place{
      .instruction = frame != nullptr ? frame[kSavedPc] : 0,
      .status = status,
      .address = system.read((status & kCfsrBusAddress) != 0 ? kBfar : kMmfar)};
  const ports::ResetCause cause =
      (status & kCfsrMemory) != 0 ? ports::ResetCause::kMemoryFault : ports::ResetCause::kFault;
  reset_log().note(cause, &place);
  restart(cause);
}

// The clock security system has switched to the internal oscillator, whose error of 1 % is too
// large for CAN. The device restarts and stays off the buses until the crystal runs
// (docs/installation.md).
void nmi_handler() {
  using namespace armtrue;
  using namespace armtrue::stm32f405;
  ports::MappedRegisters rcc(0x40023800);
  restart(take_clock_failure(rcc) ? ports::ResetCause::kClock : ports::ResetCause::kFault);
}
}
