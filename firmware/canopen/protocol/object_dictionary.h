// The object dictionary: one RAM image of all values, found by index and sub-index or by Ref.
//
// The entries are generated from armtrue.eds; this class only stores their values. Access rights,
// limits and side effects are handled by DictionaryAccess.
#ifndef ARMTRUE_FIRMWARE_CANOPEN_PROTOCOL_OBJECT_DICTIONARY_H_
#define ARMTRUE_FIRMWARE_CANOPEN_PROTOCOL_OBJECT_DICTIONARY_H_

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <type_traits>

#include "firmware/canopen/od_generated.h"
#include "firmware/canopen/protocol/little_endian.h"

namespace armtrue::canopen {

// Bounds of the communication profile area (CiA 301, 7.4.3), and the end of all indices.
inline constexpr std::uint32_t kCommunicationBegin = 0x1000;
inline constexpr std::uint32_t kCommunicationEnd = 0x2000;
inline constexpr std::uint32_t kIndexEnd = 0x10000;

class ObjectDictionary {
 public:
  // Sets every value to the EDS default, those relative to the node-ID included. Strings that the
  // device filled in at start are kept.
  void restore_defaults(std::uint8_t node_id);

  // The same for the communication profile area (0x1000–0x1FFF) only, as NMT reset communication
  // demands (CiA 301, 7.3.2.2.1).
  void restore_communication_defaults(std::uint8_t node_id);

  // The entry of `index`, `sub`, if there is one.
  std::optional<od::Entry> find(std::uint16_t index, std::uint8_t sub) const;

  // Whether any sub-index of `index` exists.
  bool has_index(std::uint16_t index) const;

  // The value as it goes on the wire; a string ends at its first zero byte. Empty for a DOMAIN.
  std::span<const std::uint8_t> bytes(const od::Entry& entry) const;

  // Overwrites a value in RAM. Precondition: data.size() == entry.size, or at most that for a
  // string.
  void assign(const od::Entry& entry, std::span<const std::uint8_t> data);

  // Read and write a value at `offset`, known from find(), without a look-up: for PDOs in every
  // cycle.
  void copy_out(std::uint16_t offset, std::span<std::uint8_t> data) const {
    std::copy_n(image_.begin() + offset, data.size(), data.begin());
  }
  void copy_in(std::uint16_t offset, std::span<const std::uint8_t> data) {
    std::copy(data.begin(), data.end(), image_.begin() + offset);
  }

  // The bounds of an entry, or nullptr if it has none.
  const od::Limit* limit(const od::Entry& entry) const;

  template <typename T>
  T get(od::Ref<T> ref) const {
    return load_le<T>(&image_[ref.offset]);
  }
  template <typename T>
  void set(od::Ref<T> ref, std::type_identity_t<T> value) {
    store_le(&image_[ref.offset], value);
  }
  void set_string(od::Ref<char> ref, const char* text);

  // Packs the values that 0x1010 saves, in entry order; `out` holds od::kStoredSize bytes.
  void pack_stored(std::span<std::uint8_t> out) const;
  // Unpacks only values of objects below `end_index`.
  void unpack_stored(std::span<const std::uint8_t> in, std::uint32_t end_index);

 private:
  // The defaults of begin_index ≤ index < end_index.
  void restore(std::uint8_t node_id, std::uint32_t begin_index, std::uint32_t end_index);

  std::array<std::uint8_t, od::kImageSize> image_ = {};
};

}  // namespace armtrue::canopen

#endif  // ARMTRUE_FIRMWARE_CANOPEN_PROTOCOL_OBJECT_DICTIONARY_H_
