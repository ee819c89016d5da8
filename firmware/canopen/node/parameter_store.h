// Parameters that 0x1010 saves: one block of bytes in non-volatile memory.
#ifndef ARMTRUE_FIRMWARE_CANOPEN_NODE_PARAMETER_STORE_H_
#define ARMTRUE_FIRMWARE_CANOPEN_NODE_PARAMETER_STORE_H_

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include "firmware/canopen/protocol/object_dictionary.h"

namespace armtrue::canopen {

// A port's non-volatile memory for parameters. A save that is cut short must leave either the old
// block or one that load() reports as absent or that fails its checksum.
class ParameterStore {
 public:
  // Fills `block` with the data saved last. False if there is none of that length.
  virtual bool load(std::span<std::uint8_t> block) = 0;
  // Whether the memory holds data that load() does not return: damaged, or of another length.
  virtual bool holds_something() const = 0;
  virtual bool save(std::span<const std::uint8_t> block) = 0;
  virtual bool erase() = 0;

 protected:
  ~ParameterStore() = default;
};

// Layout fingerprint, values, CRC-32.
inline constexpr std::size_t kParameterBlockSize = 4 + od::kStoredSize + 4;

// Saves all parameters that 0x1010 covers. False if the memory failed.
bool save_parameters(const ObjectDictionary& dictionary, ParameterStore& store);

// Result of load_parameters().
enum class Loaded : std::uint8_t {
  kParameters,
  kNone,     // never saved, or erased
  kOther,    // saved by a firmware with another dictionary
  kDamaged,  // saved, but unreadable or with a wrong checksum
};

// Overwrites the values of objects below `end_index` with the saved parameters. With any other
// result than kParameters nothing has changed.
Loaded load_parameters(ObjectDictionary& dictionary, ParameterStore& store,
                       std::uint32_t end_index = kIndexEnd);

}  // namespace armtrue::canopen

#endif  // ARMTRUE_FIRMWARE_CANOPEN_NODE_PARAMETER_STORE_H_
