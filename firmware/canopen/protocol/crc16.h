// The CRC of SDO block transfer: polynomial 0x1021, start 0, no reflection (CiA 301, 7.2.4.3.16).
#ifndef ARMTRUE_FIRMWARE_CANOPEN_PROTOCOL_CRC16_H_
#define ARMTRUE_FIRMWARE_CANOPEN_PROTOCOL_CRC16_H_

#include <cstdint>
#include <span>

namespace armtrue::canopen {

// Continues `crc` over `data`.
constexpr std::uint16_t crc16(std::span<const std::uint8_t> data, std::uint16_t crc = 0) {
  for (const std::uint8_t byte : data) {
    crc = static_cast<std::uint16_t>(crc ^ (byte << 8));
    for (int bit = 0; bit < 8; ++bit) {
      const bool carry = (crc & 0x8000U) != 0;
      crc = static_cast<std::uint16_t>(crc << 1);
      if (carry) crc ^= 0x1021U;
    }
  }
  return crc;
}

}  // namespace armtrue::canopen

#endif  // ARMTRUE_FIRMWARE_CANOPEN_PROTOCOL_CRC16_H_
