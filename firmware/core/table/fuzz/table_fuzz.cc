// libFuzzer on the table reader and the joint path: every accepted table must be harmless.
//
// The first byte chooses how the rest is read: as it is (tests the envelope), or with length and
// checksum corrected, so that changed contents pass the envelope. An accepted image then runs
// control cycles with inputs from its own bytes. Checked besides the sanitizers: a refusal points
// into the image, no correction exceeds the compile-time limits, and subtracting the correction
// from the output gives the target exactly.
#include <algorithm>
#include <array>
#include <cstdint>
#include <cstdlib>
#include <memory>
#include <span>
#include <vector>

#include "firmware/core/compensator.h"
#include "firmware/core/crypto/crc32.h"
#include "firmware/core/fixed/bytes.h"
#include "firmware/core/table/format.h"

namespace {

using namespace armtrue;

void require(bool condition) {
  if (!condition) std::abort();
}

void store_u32(std::uint8_t* at, std::uint32_t value) {
  for (unsigned i = 0; i < 4; ++i) at[i] = static_cast<std::uint8_t>(value >> (8U * i));
}

void mend_envelope(std::vector<std::uint8_t>& image) {
  if (image.size() < format::header::kLength + format::kChecksumLength) return;
  store_u32(&image[format::header::kMagicAt], format::kMagic);
  store_u32(&image[format::header::kImageLengthAt], static_cast<std::uint32_t>(image.size()));
  const std::size_t end = image.size() - format::kChecksumLength;
  store_u32(&image[end], crc32(std::span(image).first(end)));
}

// Numbers derived from the image's bytes, which are read cyclically.
class Source {
 public:
  explicit Source(std::span<const std::uint8_t> bytes) : bytes_(bytes) {}
  std::int32_t next() {
    std::uint32_t word = 0;
    for (unsigned i = 0; i < 4; ++i) {
      word = (word << 8U) | bytes_[at_ % bytes_.size()];
      at_ += 7;
    }
    return static_cast<std::int32_t>(word * 2654435761U);
  }

 private:
  std::span<const std::uint8_t> bytes_;
  std::size_t at_ = 0;
};

void run_cycles(Compensator& compensator, std::span<const std::uint8_t> image, std::size_t joints,
                std::array<std::int64_t, kMaxJoints> largest) {
  Source source(image);
  CycleInput input;
  for (int cycle = 0; cycle < 60; ++cycle) {
    for (std::size_t k = 0; k < joints; ++k) {
      // Steps as in a stream of targets; every tenth target is arbitrary.
      input.target[k] =
          cycle % 10 == 9 ? source.next() : input.target[k] / 2 + (source.next() >> 10);
    }
    for (std::int32_t& temperature : input.temperature_mdegc)
      temperature = source.next() >> (cycle % 20);
    input.temperature_valid = static_cast<std::uint32_t>(source.next());
    input.payload_g = source.next() >> (cycle % 20);
    input.time_ms = static_cast<std::uint32_t>(source.next());
    const CycleOutput output = compensator.cycle(input);
    for (std::size_t k = 0; k < joints; ++k) {
      const std::int64_t correction = compensator.correction_of(output.cycle, k);
      require(compensator.bounds(k).wrapped(output.corrected[k] - correction) == input.target[k]);
      require(std::abs(std::int64_t{output.delta[k]}) <= largest[k]);
    }
  }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (size < 1) return 0;
  std::vector<std::uint8_t> image(data + 1, data + size);
  if ((data[0] & 1U) != 0U) mend_envelope(image);
  const std::size_t joints =
      image.size() > format::header::kJointCountAt
          ? std::clamp<std::size_t>(image[format::header::kJointCountAt], 1, kMaxJoints)
          : 6;
  auto compensator = std::make_unique<Compensator>(
      CompensatorConfig{.joint_count = static_cast<std::uint8_t>(joints)});
  const Validation validation = compensator->load(image, {});
  if (!validation.accepted()) {
    require(validation.field <= image.size());
    return 0;
  }
  const TableView table{std::span<const std::uint8_t>(image)};
  std::array<std::int64_t, kMaxJoints> largest = {};
  for (std::size_t k = 0; k < joints; ++k) {
    // The limit in increments, rounded up, and one for the rounding of the increment itself.
    const std::int64_t limit = largest_correction(table, k);
    const std::int64_t mantissa = load_i32(table.joint(k) + format::joint::kIncrementPerUnitAt);
    const int shift = table.joint(k)[format::joint::kIncrementShiftAt];
    const std::int64_t product = limit * std::abs(mantissa);
    largest[k] = std::min<std::int64_t>((product >> shift) + 2, INT64_C(1) << 33);
  }
  require(compensator->activate());
  run_cycles(*compensator, image, joints, largest);
  compensator->disable();
  run_cycles(*compensator, image, joints, largest);
  return 0;
}
