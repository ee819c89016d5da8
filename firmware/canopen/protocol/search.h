// Linear search. std::find, find_if, any_of and all_of of libstdc++ are unrolled by four, also
// where size is what counts: a hundred bytes for each use.
#ifndef ARMTRUE_FIRMWARE_CANOPEN_PROTOCOL_SEARCH_H_
#define ARMTRUE_FIRMWARE_CANOPEN_PROTOCOL_SEARCH_H_

#include <cstddef>
#include <span>

namespace armtrue::canopen {

// The first element for which `is_it` holds, nullptr where there is none.
template <typename T, std::size_t kExtent, typename Predicate>
const T* first_where(std::span<const T, kExtent> elements, Predicate is_it) {
  for (const T& element : elements) {
    if (is_it(element)) return &element;
  }
  return nullptr;
}

}  // namespace armtrue::canopen

#endif  // ARMTRUE_FIRMWARE_CANOPEN_PROTOCOL_SEARCH_H_
