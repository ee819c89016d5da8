// Stand-ins for table images, for tests: every byte depends on which image it belongs to.
#ifndef ARMTRUE_FIRMWARE_STORAGE_TEST_TABLES_H_
#define ARMTRUE_FIRMWARE_STORAGE_TEST_TABLES_H_

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "firmware/storage/slot_store.h"

namespace armtrue::storage {

using Image = std::vector<std::uint8_t>;

// First byte: verdict of the verifier below. Second: which image. The others follow from it.
inline Image make_image(std::uint8_t name, std::size_t size,
                        TableVerdict verdict = TableVerdict::kAccepted) {
  Image image(size);
  image[0] = static_cast<std::uint8_t>(verdict);
  for (std::size_t i = 1; i < size; ++i) image[i] = static_cast<std::uint8_t>(name + 37 * (i - 1));
  return image;
}

class TestVerifier : public TableVerifier {
 public:
  TableVerdict verify(std::span<const std::uint8_t> image) const override {
    for (std::size_t i = 2; i < image.size(); ++i) {
      if (image[i] != static_cast<std::uint8_t>(image[i - 1] + 37)) return TableVerdict::kRefused;
    }
    return static_cast<TableVerdict>(image[0]);
  }
};

}  // namespace armtrue::storage

#endif  // ARMTRUE_FIRMWARE_STORAGE_TEST_TABLES_H_
