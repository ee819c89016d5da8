#include "firmware/canopen/protocol/pdo.h"

#include <algorithm>
#include <cstring>

#include "firmware/canopen/protocol/cob_id.h"

namespace armtrue::canopen {
namespace {

constexpr std::uint16_t kRpdoCommunication = 0x1400;
constexpr std::uint16_t kRpdoMapping = 0x1600;
constexpr std::uint16_t kTpdoCommunication = 0x1800;
constexpr std::uint16_t kTpdoMapping = 0x1A00;
constexpr std::uint16_t kPdoEnd = 0x1C00;

struct MapWord {
  std::uint16_t index;
  std::uint8_t sub;
  std::uint8_t bits;
};

constexpr MapWord split(std::uint32_t word) {
  return {static_cast<std::uint16_t>(word >> 16), static_cast<std::uint8_t>(word >> 8),
          static_cast<std::uint8_t>(word)};
}

// Data types as dummy entries (CiA 301, 7.4.7): bytes of a PDO that are for other nodes.
constexpr bool is_dummy(std::uint16_t index) { return index >= 0x0001 && index <= 0x0007; }

constexpr std::uint8_t dummy_bits(std::uint16_t index) {
  constexpr std::uint8_t kBits[] = {0, 8, 8, 16, 32, 8, 16, 32};  // BOOLEAN takes a whole byte here
  return kBits[index];
}

// Objects that the node receives from the drives by RPDO although they are read-only for clients.
bool is_heard(std::uint16_t index) {
  const std::uint16_t object = axis_object(index);
  return object == kActualPosition || object == 0x6041 || object == 0x6061;
}

Abort check_map_word(const ObjectDictionary& dictionary, std::uint32_t word, bool receive) {
  const MapWord map = split(word);
  if (is_dummy(map.index)) {
    return receive && map.sub == 0 && map.bits == dummy_bits(map.index) ? Abort::kNone
                                                                        : Abort::kNotMappable;
  }
  const std::optional<od::Entry> entry = dictionary.find(map.index, map.sub);
  if (!entry) return dictionary.has_index(map.index) ? Abort::kNoSubIndex : Abort::kNoObject;
  const bool allowed = receive ? (entry->flags & od::kWritable) != 0 || is_heard(map.index)
                               : (entry->flags & od::kReadable) != 0;
  const bool mappable = (entry->flags & od::kMappable) != 0 && entry->size * 8 == map.bits;
  return mappable && allowed ? Abort::kNone : Abort::kNotMappable;
}

// No RPDO may map both targets (from the controller) and actual positions (from the drives): its
// targets would be obeyed in NMT states in which only actual positions are taken.
enum Side : std::uint8_t { kOfNeither = 0, kOfController = 1, kOfDrives = 2, kOfBoth = 3 };

std::uint8_t side_of(std::uint16_t index) {
  const std::uint16_t object = axis_object(index);
  if (object == kTargetPosition) return kOfController;
  return object == kActualPosition ? kOfDrives : kOfNeither;
}

Abort check_cob_id(std::uint32_t present, std::uint32_t wanted) {
  if ((wanted & (kExtended | kReservedIdBits)) != 0) return Abort::kValueRange;
  if ((wanted & kInvalid) != 0) return Abort::kNone;
  // While a PDO is valid only its validity may change.
  if ((present & kInvalid) == 0 && (present & kIdMask) != (wanted & kIdMask)) {
    return Abort::kValueRange;
  }
  return is_restricted_id(wanted & kIdMask) ? Abort::kValueRange : Abort::kNone;
}

// Checks a COB-ID in force, too: saved parameters could hold anything.
bool names_pdo(std::uint32_t cob_id) {
  return (cob_id & (kInvalid | kExtended | kReservedIdBits)) == 0;
}

Abort check_transmission(std::uint8_t type) {
  // 241..251 are reserved, 252 and 253 are sent on remote request, which this node does not answer.
  return type > 240 && type < 254 ? Abort::kValueRange : Abort::kNone;
}

Abort check_mapping(const ObjectDictionary& dictionary, std::uint16_t index, std::uint8_t sub,
                    std::uint32_t value, bool receive, std::size_t payload_max) {
  const std::uint16_t communication =
      static_cast<std::uint16_t>(index - kRpdoMapping + kRpdoCommunication);
  const std::optional<od::Entry> cob = dictionary.find(communication, 1);
  const bool valid = (load_le<std::uint32_t>(dictionary.bytes(*cob).data()) & kInvalid) == 0;
  if (valid) return Abort::kUnsupportedAccess;
  if (sub > 0) {
    const std::uint8_t count = dictionary.bytes(*dictionary.find(index, 0))[0];
    if (count != 0) return Abort::kUnsupportedAccess;
    return value == 0 ? Abort::kNone : check_map_word(dictionary, value, receive);
  }
  if (value > kMappedMax) return Abort::kPdoLength;
  std::size_t bytes = 0;
  std::uint8_t sides = kOfNeither;
  for (std::uint32_t k = 1; k <= value; ++k) {
    const std::optional<od::Entry> entry = dictionary.find(index, static_cast<std::uint8_t>(k));
    const auto word = load_le<std::uint32_t>(dictionary.bytes(*entry).data());
    if (const Abort abort = check_map_word(dictionary, word, receive); abort != Abort::kNone) {
      return Abort::kNotMappable;
    }
    sides |= side_of(split(word).index);
    if (receive && sides == kOfBoth) return Abort::kNotMappable;
    bytes += split(word).bits / 8U;
  }
  return bytes <= payload_max ? Abort::kNone : Abort::kPdoLength;
}

}  // namespace

bool Mapping::has_axis_object(std::uint16_t object) const {
  return std::ranges::any_of(
      used(), [object](const MappedEntry& mapped) { return axis_object(mapped.index) == object; });
}

std::uint32_t mapped_axes(std::span<const Pdo> pdos, std::uint16_t object) {
  std::uint32_t axes = 0;
  for (const Pdo& pdo : pdos) {
    for (const MappedEntry& mapped : pdo.mapping.used()) {
      if (pdo.valid && axis_object(mapped.index) == object) axes |= 1U << axis_of(mapped.index);
    }
  }
  return axes;
}

Mapping PdoTable::decode(od::Ref<std::uint8_t> count, od::Ref<std::uint32_t> first,
                         bool receive) const {
  Mapping mapping;
  std::uint8_t sides = kOfNeither;
  const std::uint8_t wanted = std::min<std::uint8_t>(dictionary_.get(count), kMappedMax);
  for (std::uint8_t k = 0; k < wanted; ++k) {
    const std::optional<od::Entry> source =
        dictionary_.find(first.index, static_cast<std::uint8_t>(first.sub + k));
    const auto word = load_le<std::uint32_t>(dictionary_.bytes(*source).data());
    // Saved parameters could hold anything: an entry that SDO would have refused ends the mapping.
    if (check_map_word(dictionary_, word, receive) != Abort::kNone) break;
    const MapWord map = split(word);
    sides |= side_of(map.index);
    if (receive && sides == kOfBoth) break;
    const auto size = static_cast<std::uint8_t>(map.bits / 8);
    if (mapping.length + size > payload_max_) break;
    MappedEntry& mapped = mapping.entries[mapping.count];  // count < wanted ≤ kMappedMax
    ++mapping.count;
    mapped.at = mapping.length;
    mapped.size = size;
    if (!is_dummy(map.index)) {
      mapped.index = map.index;
      mapped.sub = map.sub;
      const od::Entry entry = *dictionary_.find(map.index, map.sub);
      mapped.offset = entry.offset;
      if (const od::Limit* limit = dictionary_.limit(entry); limit != nullptr) {
        mapped.limit = static_cast<std::uint8_t>(limit - od::kLimits);
      }
    }
    mapping.length = static_cast<std::uint8_t>(mapping.length + size);
  }
  return mapping;
}

bool PdoTable::has_id(std::uint32_t id, const Pdo* except) const {
  const auto has = [id, except](const Pdo& pdo) {
    return pdo.valid && pdo.id == id && &pdo != except;
  };
  return std::ranges::any_of(rpdos_, has) || std::ranges::any_of(tpdos_, has);
}

bool PdoTable::is_free(std::uint32_t id, const Pdo& pdo) const {
  return id != (dictionary_.get(od::kCOBIDSYNCMessage) & kIdMask) && !has_id(id, &pdo);
}

bool PdoTable::may_switch_on(std::uint16_t record, std::uint32_t id) const {
  if (record >= kTpdoCommunication) return is_free(id, tpdos_[record - kTpdoCommunication]);
  const std::size_t number = record - kRpdoCommunication;
  return is_free(id, rpdos_[number]) && !repeats_target(number);
}

// Saved parameters could hold anything: of two PDOs with one identifier the first is valid.
void PdoTable::switch_on(Pdo& pdo, std::uint32_t cob_id) const {
  pdo.id = cob_id & kIdMask;
  pdo.valid = names_pdo(cob_id) && pdo.mapping.count > 0 && is_free(pdo.id, pdo);
}

void PdoTable::refresh() {
  for (Pdo& pdo : rpdos_) pdo.valid = false;
  for (Pdo& pdo : tpdos_) pdo.valid = false;
  for (std::size_t k = 0; k < kRpdos; ++k) {
    const std::uint32_t cob_id = dictionary_.get(od::rpdo::kCOBID[k]);
    Pdo& pdo = rpdos_[k];
    pdo.transmission = dictionary_.get(od::rpdo::kTransmissionType[k]);
    pdo.mapping = decode(od::rpdo::kMappingCount[k], od::rpdo::kMapping[k], true);
    switch_on(pdo, cob_id);
  }
  for (std::size_t k = 0; k < kTpdos; ++k) {
    const std::uint32_t cob_id = dictionary_.get(od::tpdo::kCOBID[k]);
    Pdo& pdo = tpdos_[k];
    pdo.transmission = dictionary_.get(od::tpdo::kTransmissionType[k]);
    pdo.mapping = decode(od::tpdo::kMappingCount[k], od::tpdo::kMapping[k], false);
    switch_on(pdo, cob_id);
  }
}

bool PdoTable::repeats_target(std::size_t number) const {
  std::uint32_t axes = mapped_axes(rpdos().first(number), kTargetPosition) |
                       mapped_axes(rpdos().subspan(number + 1), kTargetPosition);
  for (const MappedEntry& mapped : rpdos_[number].mapping.used()) {
    if (axis_object(mapped.index) != kTargetPosition) continue;
    const std::uint32_t axis = 1U << axis_of(mapped.index);
    if ((axes & axis) != 0) return true;
    axes |= axis;
  }
  return false;
}

std::size_t PdoTable::match(const CanFrame& frame) const {
  if (frame.is(kFrameExtended) || frame.is(kFrameRemote)) return kRpdos;
  for (std::size_t k = 0; k < kRpdos; ++k) {
    if (rpdos_[k].valid && rpdos_[k].id == frame.id) return k;
  }
  return kRpdos;
}

Abort check_pdo_write(const ObjectDictionary& dictionary, const od::Entry& entry,
                      std::span<const std::uint8_t> value, std::size_t payload_max) {
  const std::uint16_t index = entry.index;
  if (index < kRpdoCommunication || index >= kPdoEnd) return Abort::kNone;
  const bool communication =
      index < kRpdoMapping || (index >= kTpdoCommunication && index < kTpdoMapping);
  if (!communication) {
    const std::uint32_t number = entry.sub == 0 ? value[0] : load_le<std::uint32_t>(value.data());
    return check_mapping(dictionary, index, entry.sub, number, index < kTpdoCommunication,
                         payload_max);
  }
  const std::optional<od::Entry> cob = dictionary.find(index, 1);
  const auto present = load_le<std::uint32_t>(dictionary.bytes(*cob).data());
  switch (entry.sub) {
    case 1:
      return check_cob_id(present, load_le<std::uint32_t>(value.data()));
    case 2:
      return check_transmission(value[0]);
    case 3:
    case 6:
      // Inhibit time and SYNC start value are not changed while the PDO is valid (CiA
      // 301, 7.5.2.37).
      return (present & kInvalid) != 0 ? Abort::kNone : Abort::kUnsupportedAccess;
    default:
      return Abort::kNone;
  }
}

void sample_tpdo(const ObjectDictionary& dictionary, const Pdo& pdo, CanFrame& frame) {
  frame = {};
  frame.id = pdo.id;
  frame.len = pdo.mapping.length;
  if (pdo.mapping.length > kClassicPayload) {
    frame.flags = kFrameFd | kFrameBitRateSwitch;
    while (!is_valid_fd_length(frame.len)) ++frame.len;
  }
  for (const MappedEntry& mapped : pdo.mapping.used()) {
    dictionary.copy_out(mapped.offset, std::span(frame.data).subspan(mapped.at, mapped.size));
  }
}

Applied apply_rpdo(ObjectDictionary& dictionary, const Pdo& pdo, const CanFrame& frame) {
  Applied applied;
  for (const MappedEntry& mapped : pdo.mapping.used()) {
    if (mapped.is_dummy()) continue;
    const std::span<const std::uint8_t> bytes =
        std::span(frame.data).subspan(mapped.at, mapped.size);
    if (mapped.limit != kUnlimited) {
      const od::Limit& limit = od::kLimits[mapped.limit];
      const std::uint32_t value = load_le(bytes);
      applied.has_bounds = true;
      if (value < limit.low || value > limit.high) {
        applied.beyond = mapped.index;
        applied.refused |= 1U << (&mapped - pdo.mapping.entries.data());
        continue;
      }
    }
    dictionary.copy_in(mapped.offset, bytes);
  }
  return applied;
}

}  // namespace armtrue::canopen
