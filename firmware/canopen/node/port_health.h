// Reset causes, last fault and chip protection, as a port reports them: object 0x2040.
#ifndef ARMTRUE_FIRMWARE_CANOPEN_NODE_PORT_HEALTH_H_
#define ARMTRUE_FIRMWARE_CANOPEN_NODE_PORT_HEALTH_H_

#include <cstdint>

namespace armtrue::canopen {

struct PortHealth {
  std::uint8_t reset_cause = 0;  // firmware/ports/common/reset_log.h
  std::uint32_t starts = 0;
  std::uint32_t history = 0;
  std::uint32_t fault_instruction = 0;
  std::uint32_t fault_status = 0;
  std::uint32_t fault_address = 0;
  std::uint32_t option_bytes = 0;
  std::uint32_t protection = 0;
  std::uint32_t supply_dips = 0;
};

// Bits of `protection`: what is in force.
enum Protection : std::uint32_t {
  kMemoryProtection = 1U << 0,
  kClockSecurity = 1U << 1,
  kVoltageDetector = 1U << 2,
  kWindowWatchdog = 1U << 3,
  kBrownOutLevel3 = 1U << 4,  // this and the following: in the option bytes
  kHardwareWatchdog = 1U << 5,
  kReadProtection = 1U << 6,
  kCodeWriteProtection = 1U << 7,
};

}  // namespace armtrue::canopen

#endif  // ARMTRUE_FIRMWARE_CANOPEN_NODE_PORT_HEALTH_H_
