// What one value of the object dictionary is: the types that the generated tables are made of.
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

// One value, as ObjectDictionary::find() puts it together.
struct Entry {
  std::uint16_t index;
  std::uint8_t sub;
  Type type;
  std::uint16_t offset;  // into the RAM image or kStrings
  std::uint8_t size;     // bytes; a string in RAM: its capacity; a DOMAIN: 0
  std::uint8_t flags;
};

// The generated tables say it in a third of the flash: most objects are built alike (axis n, RPDO
// n), and so are neighbouring sub-indexes. An object names its shape, a shape is a row of runs.
struct Run {
  std::uint8_t sub;  // the first of `count` values that differ in nothing but their place
  std::uint8_t count;
  Type type;
  std::uint8_t size;
  std::uint8_t flags;
};
struct Object {
  std::uint16_t index;
  std::uint16_t offset;  // of its first value; the others follow without gaps
  std::uint8_t shape;    // runs kShapes[shape] to kShapes[shape + 1]
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

// The same value of neighbours that lie at even distances: element k of an array, of RPDO k, of
// axis k. A table of Refs would say the same in six bytes of flash each.
template <typename T, std::size_t N>
struct RefRow {
  Ref<T> first;
  std::uint16_t index_step;
  std::uint8_t sub_step;
  std::uint16_t offset_step;
  constexpr Ref<T> operator[](std::size_t k) const {
    return {static_cast<std::uint16_t>(first.index + k * index_step),
            static_cast<std::uint8_t>(first.sub + k * sub_step),
            static_cast<std::uint16_t>(first.offset + k * offset_step)};
  }
  constexpr std::size_t size() const { return N; }
};

}  // namespace armtrue::canopen::od

#endif  // ARMTRUE_FIRMWARE_CANOPEN_PROTOCOL_OD_ENTRY_H_
