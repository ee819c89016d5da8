// CRC-32 of ISO 3309 (reflected polynomial 0xEDB88320, as in Ethernet, zlib, PNG).
#ifndef ARMTRUE_FIRMWARE_CORE_CRYPTO_CRC32_H_
#define ARMTRUE_FIRMWARE_CORE_CRYPTO_CRC32_H_

#include <cstdint>
#include <span>

namespace armtrue {

// The checksum of `bytes`; pass an earlier result as `before` to continue over a further piece.
std::uint32_t crc32(std::span<const std::uint8_t> bytes, std::uint32_t before = 0);

}  // namespace armtrue

#endif  // ARMTRUE_FIRMWARE_CORE_CRYPTO_CRC32_H_
