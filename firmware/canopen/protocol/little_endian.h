// CANopen transfers numbers in little-endian byte order (CiA 301, 7.1.3).
#ifndef ARMTRUE_FIRMWARE_CANOPEN_PROTOCOL_LITTLE_ENDIAN_H_
#define ARMTRUE_FIRMWARE_CANOPEN_PROTOCOL_LITTLE_ENDIAN_H_

#include <algorithm>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <span>
#include <type_traits>

namespace armtrue::canopen {

// Reads sizeof(T) bytes.
template <std::integral T>
constexpr T load_le(const std::uint8_t* bytes) {
  std::uint32_t value = 0;
  static_assert(sizeof(T) <= sizeof(value));
  for (std::size_t k = 0; k < sizeof(T); ++k) {
    value |= static_cast<std::uint32_t>(bytes[k]) << (8 * k);
  }
  return static_cast<T>(value);
}

// Reads up to four bytes and ignores the rest.
constexpr std::uint32_t load_le(std::span<const std::uint8_t> bytes) {
  std::uint32_t value = 0;
  for (std::size_t k = std::min<std::size_t>(bytes.size(), 4); k > 0; --k) {
    value = value << 8 | bytes[k - 1];
  }
  return value;
}

// Writes sizeof(T) bytes.
template <std::integral T>
constexpr void store_le(std::uint8_t* bytes, T value) {
  const auto bits = static_cast<std::make_unsigned_t<T>>(value);
  for (std::size_t k = 0; k < sizeof(T); ++k) {
    bytes[k] = static_cast<std::uint8_t>(static_cast<std::uint32_t>(bits) >> (8 * k));
  }
}

}  // namespace armtrue::canopen

#endif  // ARMTRUE_FIRMWARE_CANOPEN_PROTOCOL_LITTLE_ENDIAN_H_
