// Bits of a COB-ID: objects 0x1005, 0x1014, 0x14xx and 0x18xx sub 1 (CiA 301, 7.5.2).
#ifndef ARMTRUE_FIRMWARE_CANOPEN_PROTOCOL_COB_ID_H_
#define ARMTRUE_FIRMWARE_CANOPEN_PROTOCOL_COB_ID_H_

#include <cstdint>

namespace armtrue::canopen {

inline constexpr std::uint32_t kInvalid = 0x80000000U;
inline constexpr std::uint32_t kExtended = 0x20000000U;
inline constexpr std::uint32_t kReservedIdBits = 0x1FFFF800U;  // used by 29-bit identifiers only
inline constexpr std::uint32_t kIdMask = 0x7FFU;

// CiA 301, table 41: identifiers of NMT, SDO and heartbeat, and reserved ones.
constexpr bool is_restricted_id(std::uint32_t id) {
  return id <= 0x07F || (id >= 0x101 && id <= 0x180) || (id >= 0x581 && id <= 0x5FF) ||
         (id >= 0x601 && id <= 0x67F) || (id >= 0x6E0 && id <= 0x6FF) || id >= 0x701;
}

}  // namespace armtrue::canopen

#endif  // ARMTRUE_FIRMWARE_CANOPEN_PROTOCOL_COB_ID_H_
