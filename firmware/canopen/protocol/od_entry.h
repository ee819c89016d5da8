// Types of the generated object dictionary: one entry describes one value.
#ifndef ARMTRUE_FIRMWARE_CANOPEN_PROTOCOL_OD_ENTRY_H_
#define ARMTRUE_FIRMWARE_CANOPEN_PROTOCOL_OD_ENTRY_H_

#include <cstddef>
#include <cstdint>

namespace armtrue::canopen::od {

// CiA 301, table 44; the numbers are the standard's.
enum class Type : std::uint8_t {
  kInteger8 = 0x02,
  kInteger16 = 0x03,
  kInteger32 = 0x04,
  kUnsigned8 = 0x05,
  kUnsigned16 = 0x06,
  kUnsigned32 = 0x07,
  kVisibleString = 0x09,
  kDomain = 0x0F,
};

enum EntryFlags : std::uint8_t {
  kReadable = 1U << 0,
  kWritable = 1U << 1,
  kMappable = 1U << 2,
  kStored = 1U << 3,  // saved by 0x1010
  kInRom = 1U << 4,   // `offset` counts in kStrings, not in the RAM image
};

// One value.
struct Entry {
  std::uint16_t index;
  std::uint8_t sub;
  Type type;
  std::uint16_t offset;  // into the RAM image or kStrings
  std::uint8_t size;     // bytes; a string in RAM: its capacity; a DOMAIN: 0
  std::uint8_t flags;
};

// Inclusive bounds of one value (unsigned types only).
struct Limit {
  std::uint16_t index;
  std::uint8_t sub;
  std::uint32_t low;
  std::uint32_t high;
};

// A typed name for one value, so that a misspelt object does not compile.
template <typename T>
struct Ref {
  std::uint16_t index;
  std::uint8_t sub;
  std::uint16_t offset;
};

}  // namespace armtrue::canopen::od

#endif  // ARMTRUE_FIRMWARE_CANOPEN_PROTOCOL_OD_ENTRY_H_
