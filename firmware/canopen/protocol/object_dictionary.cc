#include "firmware/canopen/protocol/object_dictionary.h"

#include <algorithm>
#include <cstring>

#include "firmware/canopen/protocol/search.h"

namespace armtrue::canopen {
namespace {

constexpr std::uint16_t kFirstCommunication = 0x1000;
constexpr std::uint16_t kLastCommunication = 0x1FFF;

// Strings in RAM are what the device says of itself: set once at start, not a parameter.
bool has_default(const od::Entry& entry) {
  return entry.type != od::Type::kDomain && entry.type != od::Type::kVisibleString;
}

const od::Object* lower_bound(std::uint16_t index) {
  return std::lower_bound(
      od::kObjects, od::kObjects + od::kObjectCount, index,
      [](const od::Object& object, std::uint16_t wanted) { return object.index < wanted; });
}

// Calls visit(entry) for every value of an object in the order of sub-indexes, until that returns
// true.
template <typename Visit>
void visit_values(const od::Object& object, const Visit& visit) {
  od::Entry entry = {object.index, 0, od::Type::kDomain, object.offset, 0, 0};
  for (std::size_t r = od::kShapes[object.shape]; r < od::kShapes[object.shape + 1U]; ++r) {
    const od::Run& run = od::kRuns[r];
    entry.sub = run.sub;
    entry.type = run.type;
    entry.size = run.size;
    entry.flags = run.flags;
    for (std::size_t i = 0; i < run.count; ++i) {
      if (visit(static_cast<const od::Entry&>(entry))) return;
      ++entry.sub;
      entry.offset = static_cast<std::uint16_t>(entry.offset + run.size);
    }
  }
}

template <typename Visit>
void visit_all(const Visit& visit) {
  for (const od::Object& object : od::kObjects) {
    visit_values(object, [&visit](const od::Entry& entry) {
      visit(entry);
      return false;
    });
  }
}

bool is_in_rom(const od::Entry& entry) { return (entry.flags & od::kInRom) != 0; }

// Unpacks od::kDefaults: the number of zeros, the number of bytes, the bytes, and so on.
class DefaultsReader {
 public:
  std::uint8_t next() {
    while (zeros_ == 0 && bytes_ == 0) {
      zeros_ = *at_++;
      bytes_ = *at_++;
    }
    if (zeros_ != 0) {
      --zeros_;
      return 0;
    }
    --bytes_;
    return *at_++;
  }

 private:
  const std::uint8_t* at_ = od::kDefaults;
  std::uint8_t zeros_ = 0;
  std::uint8_t bytes_ = 0;
};

}  // namespace

void ObjectDictionary::restore(std::uint8_t node_id, std::uint16_t first_index,
                               std::uint16_t last_index) {
  DefaultsReader defaults;
  visit_all([&](const od::Entry& entry) {
    if (is_in_rom(entry)) return;
    const bool wanted =
        entry.index >= first_index && entry.index <= last_index && has_default(entry);
    for (std::size_t i = 0; i < entry.size; ++i) {
      const std::uint8_t value = defaults.next();
      if (wanted) image_[entry.offset + i] = value;
    }
    const bool relative = first_where(std::span(od::kNodeRelative), [&entry](std::uint16_t offset) {
                            return offset == entry.offset;
                          }) != nullptr;
    if (wanted && relative) {
      std::uint8_t* place = &image_[entry.offset];
      store_le(place, load_le<std::uint32_t>(place) + node_id);
    }
  });
}

void ObjectDictionary::restore_defaults(std::uint8_t node_id) { restore(node_id, 0, 0xFFFF); }

void ObjectDictionary::restore_communication_defaults(std::uint8_t node_id) {
  restore(node_id, kFirstCommunication, kLastCommunication);
}

std::optional<od::Entry> ObjectDictionary::find(std::uint16_t index, std::uint8_t sub) const {
  std::optional<od::Entry> found;
  const od::Object* object = lower_bound(index);
  if (object != od::kObjects + od::kObjectCount && object->index == index) {
    visit_values(*object, [&found, sub](const od::Entry& entry) {
      if (entry.sub == sub) found = entry;
      return found.has_value();
    });
  }
  return found;
}

bool ObjectDictionary::has_index(std::uint16_t index) const {
  const od::Object* object = lower_bound(index);
  return object != od::kObjects + od::kObjectCount && object->index == index;
}

std::span<const std::uint8_t> ObjectDictionary::bytes(const od::Entry& entry) const {
  if (is_in_rom(entry)) {
    return {reinterpret_cast<const std::uint8_t*>(od::kStrings + entry.offset), entry.size};
  }
  const std::span<const std::uint8_t> value{image_.data() + entry.offset, entry.size};
  if (entry.type != od::Type::kVisibleString) return value;
  const std::uint8_t* end = first_where(value, [](std::uint8_t byte) { return byte == 0; });
  return end == nullptr ? value : value.first(static_cast<std::size_t>(end - value.data()));
}

void ObjectDictionary::assign(const od::Entry& entry, std::span<const std::uint8_t> data) {
  std::copy(data.begin(), data.end(), image_.begin() + entry.offset);
}

const od::Limit* ObjectDictionary::limit(const od::Entry& entry) const {
  return first_where(std::span(od::kLimits, od::kLimitCount), [&entry](const od::Limit& limit) {
    return limit.index == entry.index && limit.sub == entry.sub;
  });
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
  visit_all([&](const od::Entry& entry) {
    if ((entry.flags & od::kStored) == 0) return;
    std::memcpy(&out[at], &image_[entry.offset], entry.size);
    at += entry.size;
  });
}

void ObjectDictionary::unpack_stored(std::span<const std::uint8_t> in) {
  std::size_t at = 0;
  visit_all([&](const od::Entry& entry) {
    if ((entry.flags & od::kStored) == 0) return;
    std::memcpy(&image_[entry.offset], &in[at], entry.size);
    at += entry.size;
  });
}

}  // namespace armtrue::canopen
