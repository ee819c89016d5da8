#include "firmware/canopen/protocol/object_dictionary.h"

#include <algorithm>
#include <cstring>
#include <iterator>
#include <utility>

namespace armtrue::canopen {
namespace {

// Strings in RAM describe the device: they are set once at start and are no parameters.
bool has_default(const od::Entry& entry) {
  return entry.type != od::Type::kDomain && entry.type != od::Type::kVisibleString;
}

// The first entry at or after `index`, `sub`.
const od::Entry* lower_bound(std::uint16_t index, std::uint8_t sub) {
  return std::lower_bound(std::begin(od::kEntries), std::end(od::kEntries), std::pair(index, sub),
                          [](const od::Entry& entry, const auto& wanted) {
                            return std::pair(entry.index, entry.sub) < wanted;
                          });
}

bool is_in_rom(const od::Entry& entry) { return (entry.flags & od::kInRom) != 0; }

}  // namespace

void ObjectDictionary::restore(std::uint8_t node_id, std::uint32_t begin_index,
                               std::uint32_t end_index) {
  for (const od::Entry& entry : od::kEntries) {
    const bool wanted = entry.index >= begin_index && entry.index < end_index && has_default(entry);
    if (!wanted || is_in_rom(entry)) continue;
    std::copy_n(od::kDefaults + entry.offset, entry.size, image_.begin() + entry.offset);
    const auto* end = std::end(od::kNodeRelative);
    if (std::find(std::begin(od::kNodeRelative), end, entry.offset) != end) {
      std::uint8_t* place = &image_[entry.offset];
      store_le(place, load_le<std::uint32_t>(place) + node_id);
    }
  }
}

void ObjectDictionary::restore_defaults(std::uint8_t node_id) { restore(node_id, 0, kIndexEnd); }

void ObjectDictionary::restore_communication_defaults(std::uint8_t node_id) {
  restore(node_id, kCommunicationBegin, kCommunicationEnd);
}

std::optional<od::Entry> ObjectDictionary::find(std::uint16_t index, std::uint8_t sub) const {
  const od::Entry* entry = lower_bound(index, sub);
  const bool found = entry != std::end(od::kEntries) && entry->index == index && entry->sub == sub;
  return found ? std::optional(*entry) : std::nullopt;
}

bool ObjectDictionary::has_index(std::uint16_t index) const {
  const od::Entry* entry = lower_bound(index, 0);
  return entry != std::end(od::kEntries) && entry->index == index;
}

std::span<const std::uint8_t> ObjectDictionary::bytes(const od::Entry& entry) const {
  if (is_in_rom(entry)) {
    return {reinterpret_cast<const std::uint8_t*>(od::kStrings + entry.offset), entry.size};
  }
  const std::span<const std::uint8_t> value{image_.data() + entry.offset, entry.size};
  if (entry.type != od::Type::kVisibleString) return value;
  const auto end = std::find(value.begin(), value.end(), std::uint8_t{0});
  return value.first(static_cast<std::size_t>(end - value.begin()));
}

void ObjectDictionary::assign(const od::Entry& entry, std::span<const std::uint8_t> data) {
  std::copy(data.begin(), data.end(), image_.begin() + entry.offset);
}

const od::Limit* ObjectDictionary::limit(const od::Entry& entry) const {
  const auto* end = std::end(od::kLimits);
  const auto* found = std::find_if(std::begin(od::kLimits), end, [&entry](const od::Limit& limit) {
    return limit.index == entry.index && limit.sub == entry.sub;
  });
  return found == end ? nullptr : found;
}

void ObjectDictionary::set_string(od::Ref<char> ref, const char* text) {
  const std::optional<od::Entry> entry = find(ref.index, ref.sub);
  std::uint8_t* place = &image_[ref.offset];
  std::memset(place, 0, entry->size);
  for (std::size_t k = 0; k < entry->size && text[k] != '\0'; ++k) {
    place[k] = static_cast<std::uint8_t>(text[k]);
  }
}

void ObjectDictionary::pack_stored(std::span<std::uint8_t> out) const {
  std::size_t at = 0;
  for (const od::Entry& entry : od::kEntries) {
    if ((entry.flags & od::kStored) == 0) continue;
    std::copy_n(image_.begin() + entry.offset, entry.size, &out[at]);
    at += entry.size;
  }
}

void ObjectDictionary::unpack_stored(std::span<const std::uint8_t> in, std::uint32_t end_index) {
  std::size_t at = 0;
  for (const od::Entry& entry : od::kEntries) {
    if ((entry.flags & od::kStored) == 0 || entry.index >= end_index) continue;
    std::copy_n(&in[at], entry.size, image_.begin() + entry.offset);
    at += entry.size;
  }
}

}  // namespace armtrue::canopen
