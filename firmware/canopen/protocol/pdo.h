// Process data objects (CiA 301, 7.2.2): communication and mapping records, decoded once so that
// the joint path needs no dictionary look-up per frame.
//
// A payload may be as long as a CAN FD frame; an entry is one to four whole bytes (granularity 8).
#ifndef ARMTRUE_FIRMWARE_CANOPEN_PROTOCOL_PDO_H_
#define ARMTRUE_FIRMWARE_CANOPEN_PROTOCOL_PDO_H_

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include "firmware/canopen/protocol/can_port.h"
#include "firmware/canopen/protocol/object_dictionary.h"
#include "firmware/canopen/protocol/sdo_abort.h"

namespace armtrue::canopen {

inline constexpr std::size_t kRpdos = std::size(od::rpdo::kCOBID);
inline constexpr std::size_t kTpdos = std::size(od::tpdo::kCOBID);
inline constexpr std::size_t kMappedMax = 8;
inline constexpr std::size_t kAxes = std::size(od::axis::kTargetPosition);

// Axis objects lie 0x800 apart (CiA 402-1); axis numbers are zero-based here.
inline constexpr std::uint16_t kAxisStride = 0x800;
inline constexpr std::uint16_t kControlword = 0x6040;
inline constexpr std::uint16_t kActualPosition = 0x6064;
inline constexpr std::uint16_t kTargetPosition = 0x607A;
inline constexpr std::uint16_t kPositionOffset = 0x60B0;

// The object of axis 1 that corresponds to `index`; `index` itself if it is no axis object.
constexpr std::uint16_t axis_object(std::uint16_t index) {
  return index < 0x6000 || index > 0x9FFF
             ? index
             : static_cast<std::uint16_t>(0x6000 + (index - 0x6000) % kAxisStride);
}
// The axis of an object; for an index outside 0x6000 to 0x9FFF a number beyond every axis.
constexpr std::size_t axis_of(std::uint16_t index) { return (index - 0x6000U) / kAxisStride; }

// The object has no bounds: a number beyond od::kLimits.
inline constexpr std::uint8_t kUnlimited = 0xFF;
static_assert(od::kLimitCount < kUnlimited);

struct MappedEntry {
  std::uint16_t index = 0;   // 0: dummy entry, the bytes are for other nodes
  std::uint16_t offset = 0;  // od::Entry::offset
  std::uint8_t sub = 0;
  std::uint8_t at = 0;  // first byte in the payload
  std::uint8_t size = 0;
  std::uint8_t limit = kUnlimited;  // position in od::kLimits, looked up once

  bool is_dummy() const { return index == 0; }
};

struct Mapping {
  std::array<MappedEntry, kMappedMax> entries = {};
  std::uint8_t count = 0;
  std::uint8_t length = 0;  // bytes

  std::span<const MappedEntry> used() const { return std::span(entries).first(count); }
  // Whether any entry is this object of any axis.
  bool has_axis_object(std::uint16_t object) const;
};

// There are 28 instances: the identifier is the first member, which leaves no padding.
struct Pdo {
  std::uint32_t id = 0;
  bool valid = false;
  std::uint8_t transmission = 255;
  Mapping mapping;

  bool is_synchronous() const { return transmission <= 240; }
};

// Bit k: a valid one of `pdos` maps `object` of axis k.
std::uint32_t mapped_axes(std::span<const Pdo> pdos, std::uint16_t object);

class PdoTable {
 public:
  // `payload_max`: bytes that a frame of the bus can carry.
  PdoTable(const ObjectDictionary& dictionary, std::size_t payload_max)
      : dictionary_(dictionary), payload_max_(payload_max) {}

  std::size_t payload_max() const { return payload_max_; }

  // Decodes all records anew.
  void refresh();

  std::span<const Pdo> rpdos() const { return rpdos_; }
  std::span<const Pdo> tpdos() const { return tpdos_; }
  const Pdo& rpdo(std::size_t number) const { return rpdos_[number]; }
  const Pdo& tpdo(std::size_t number) const { return tpdos_[number]; }

  // True if RPDO `number` maps the target position of one axis twice, or of an axis that another
  // valid RPDO maps as well.
  bool repeats_target(std::size_t number) const;

  // Whether a valid PDO has this identifier; `except` is not counted.
  bool has_id(std::uint32_t id, const Pdo* except = nullptr) const;

  // Whether the PDO whose communication record is 0x1400 to 0x1BFF may become valid with this
  // identifier. Not if SYNC or another valid PDO has it: a received frame is served once, and two
  // senders of one identifier collide. Not if it is an RPDO that repeats a target.
  bool may_switch_on(std::uint16_t record, std::uint32_t id) const;

  // The number of the valid RPDO with the identifier of `frame`, kRpdos if there is none.
  std::size_t match(const CanFrame& frame) const;

 private:
  Mapping decode(od::Ref<std::uint8_t> count, od::Ref<std::uint32_t> first, bool receive) const;
  bool is_free(std::uint32_t id, const Pdo& pdo) const;
  void switch_on(Pdo& pdo, std::uint32_t cob_id) const;

  const ObjectDictionary& dictionary_;
  std::size_t payload_max_;
  std::array<Pdo, kRpdos> rpdos_ = {};
  std::array<Pdo, kTpdos> tpdos_ = {};
};

// The rules of CiA 301 for writing 0x1400–0x1BFF: a valid PDO is not changed, a mapping is switched
// off before it is changed, identifiers of other services are refused, only what exists and may be
// mapped is mapped. kNone for every other object.
Abort check_pdo_write(const ObjectDictionary& dictionary, const od::Entry& entry,
                      std::span<const std::uint8_t> value, std::size_t payload_max);

// Fills `frame` (identifier, length, payload) from the dictionary. Longer than 8 bytes: an FD
// frame.
void sample_tpdo(const ObjectDictionary& dictionary, const Pdo& pdo, CanFrame& frame);

// Result of apply_rpdo().
struct Applied {
  bool has_bounds = false;    // whether any mapped object has limits
  std::uint16_t beyond = 0;   // index of the last object whose value was out of bounds; 0: none
  std::uint32_t refused = 0;  // bit k: value k of the mapping was out of bounds
};

// Writes a received payload into the dictionary, except values beyond the bounds of their object:
// an SDO download of these is refused, too. Precondition: frame.len >= pdo.mapping.length.
Applied apply_rpdo(ObjectDictionary& dictionary, const Pdo& pdo, const CanFrame& frame);

}  // namespace armtrue::canopen

#endif  // ARMTRUE_FIRMWARE_CANOPEN_PROTOCOL_PDO_H_
