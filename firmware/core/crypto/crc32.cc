#include "firmware/core/crypto/crc32.h"

#include <array>

namespace armtrue {
namespace {

// Four bits at a time: 64 bytes of table instead of 1024.
constexpr std::array<std::uint32_t, 16> make_nibble_table() {
  std::array<std::uint32_t, 16> table = {};
  for (std::uint32_t i = 0; i < table.size(); ++i) {
    std::uint32_t value = i;
    for (int bit = 0; bit < 4; ++bit) {
      value = (value >> 1U) ^ ((value & 1U) != 0U ? 0xEDB88320U : 0U);
    }
    table[i] = value;
  }
  return table;
}

constexpr std::array<std::uint32_t, 16> kNibbles = make_nibble_table();

}  // namespace

std::uint32_t crc32(std::span<const std::uint8_t> bytes, std::uint32_t before) {
  std::uint32_t value = ~before;
  for (const std::uint8_t byte : bytes) {
    value ^= byte;
    value = (value >> 4U) ^ kNibbles[value & 15U];
    value = (value >> 4U) ^ kNibbles[value & 15U];
  }
  return ~value;
}

}  // namespace armtrue
