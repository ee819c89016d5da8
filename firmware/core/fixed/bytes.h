// Little-endian loads from a table image. Byte by byte, so that they work with any alignment and
// byte order; compilers turn each into one load on little-endian cores.
#ifndef ARMTRUE_FIRMWARE_CORE_FIXED_BYTES_H_
#define ARMTRUE_FIRMWARE_CORE_FIXED_BYTES_H_

#include <cstddef>
#include <cstdint>

namespace armtrue {

constexpr std::uint16_t load_u16(const std::uint8_t* at) {
  return static_cast<std::uint16_t>(at[0] | (at[1] << 8));
}

constexpr std::uint32_t load_u32(const std::uint8_t* at) {
  return static_cast<std::uint32_t>(at[0]) | (static_cast<std::uint32_t>(at[1]) << 8U) |
         (static_cast<std::uint32_t>(at[2]) << 16U) | (static_cast<std::uint32_t>(at[3]) << 24U);
}

constexpr std::int32_t load_i32(const std::uint8_t* at) {
  return static_cast<std::int32_t>(load_u32(at));
}

constexpr std::int16_t load_i16(const std::uint8_t* at) {
  return static_cast<std::int16_t>(load_u16(at));
}

constexpr std::int8_t load_i8(const std::uint8_t* at) { return static_cast<std::int8_t>(*at); }

constexpr std::int64_t load_i64(const std::uint8_t* at) {
  return static_cast<std::int64_t>(static_cast<std::uint64_t>(load_u32(at)) |
                                   (static_cast<std::uint64_t>(load_u32(at + 4)) << 32U));
}

}  // namespace armtrue

#endif  // ARMTRUE_FIRMWARE_CORE_FIXED_BYTES_H_
