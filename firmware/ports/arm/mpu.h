// The memory protection unit of a Cortex-M3, M4 or M7 (Arm DDI 0403, B3.5). When it is on, every
// access that no region allows is a fault: to the null page, execution from RAM, a stack overflow,
// a write to the image.
#ifndef ARMTRUE_FIRMWARE_PORTS_ARM_MPU_H_
#define ARMTRUE_FIRMWARE_PORTS_ARM_MPU_H_

#include <bit>
#include <cstdint>
#include <span>

#include "firmware/ports/common/register_block.h"

namespace armtrue::ports {

namespace mpu {

// Register offsets from 0xE000ED90 and bits, named as in the manual.
inline constexpr std::uint32_t kType = 0x00;
inline constexpr std::uint32_t kCtrl = 0x04;
inline constexpr std::uint32_t kRbar = 0x0C;
inline constexpr std::uint32_t kRasr = 0x10;
inline constexpr std::uint32_t kCtrlEnable = 1U << 0;  // no background region, off in HardFault
inline constexpr std::uint32_t kRbarValid = 1U << 4;
inline constexpr std::uint32_t kRasrEnable = 1U << 0;
inline constexpr std::uint32_t kRasrExecuteNever = 1U << 28;

}  // namespace mpu

enum class Access : std::uint32_t { kNone = 0U << 24, kReadWrite = 3U << 24, kReadOnly = 6U << 24 };
enum class Memory : std::uint32_t { kNormal = 1U << 17, kDevice = 1U << 18 | 1U << 16 };

// `bytes` is a power of two, at least 32, and divides `base`. Where regions overlap, the later one
// in the list applies.
struct MpuRegion {
  std::uint32_t base;
  std::uint32_t bytes;
  Access access;
  Memory memory = Memory::kNormal;
  bool is_executable = false;
};

constexpr bool is_valid(const MpuRegion& region) {
  return std::has_single_bit(region.bytes) && region.bytes >= 32 &&
         (region.base & (region.bytes - 1)) == 0;
}

// False if there is no unit with so many regions, a region is not valid, or the unit does not read
// back as on.
template <RegisterBlock Registers>
bool start_mpu(Registers& registers, std::span<const MpuRegion> regions) {
  const std::uint32_t available = registers.read(mpu::kType) >> 8U & 0xFFU;
  if (available < regions.size()) return false;
  registers.write(mpu::kCtrl, 0);
  std::uint32_t number = 0;
  for (const MpuRegion& region : regions) {
    if (!is_valid(region)) return false;
    const auto size = static_cast<std::uint32_t>(std::countr_zero(region.bytes)) - 1U;
    registers.write(mpu::kRbar, region.base | mpu::kRbarValid | number++);
    registers.write(mpu::kRasr, (region.is_executable ? 0U : mpu::kRasrExecuteNever) |
                                    static_cast<std::uint32_t>(region.access) |
                                    static_cast<std::uint32_t>(region.memory) | size << 1U |
                                    mpu::kRasrEnable);
  }
  registers.write(mpu::kCtrl, mpu::kCtrlEnable);
  return registers.read(mpu::kCtrl) == mpu::kCtrlEnable;
}

}  // namespace armtrue::ports

#endif  // ARMTRUE_FIRMWARE_PORTS_ARM_MPU_H_
