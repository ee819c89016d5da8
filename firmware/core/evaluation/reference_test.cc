// Corrections of whole arms against the exact inverse in double precision, which Python computed
// from the same models and wrote with their images into reference/ (tests/firmware/
// reference_cases.py).
#include <gtest/gtest.h>

#include <cstring>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <memory>
#include <ostream>
#include <stdexcept>
#include <string>
#include <vector>

#include "firmware/core/evaluation/inverse.h"
#include "firmware/core/table/table.h"
#include "firmware/core/table/test_image.h"

namespace armtrue {
namespace {

// `permitted`: the largest difference from the exact correction of any joint, 2^-32 turn or metre
// (1.5 nrad, 0.23 nm).
struct Arm {
  const char* file;
  std::int64_t permitted;
  std::uint32_t checksum;  // CRC-32 of all corrections, to the last bit
};

void PrintTo(const Arm& arm, std::ostream* out) { *out << arm.file; }

// If as many tool coordinates are held as there are joints, or only joint errors are corrected, the
// correction is unique and only rounding differs.
constexpr std::int64_t kRounding = 200;
// With fewer coordinates held than there are joints, many corrections bring the tool to the same
// point. The reference and the firmware take the shortest one by Jacobians at slightly different
// joints, so their joint values may differ by some thousandths of the correction.
constexpr std::int64_t kRedundant = 50'000;

// The checksums change only with a decision: a robot that was verified with one build of the
// firmware moves the same, bit for bit, with the next.
constexpr Arm kArms[] = {
    {"kr30", kRedundant, 0x3F6E62D4},       {"kr30_pose", kRounding, 0x7E629808},
    {"skewed_pose", kRounding, 0x9EE3C643}, {"scara", kRedundant, 0x5AF0843A},
    {"stanford", kRedundant, 0x00F5CFAD},   {"stanford_pose", kRounding, 0x18CD30DB},
    {"tables", kRounding, 0x719D01A9},      {"nodes", kRounding, 0xCC498632},
    {"at_command", kRedundant, 0xC9235C4F}};

class Reader {
 public:
  explicit Reader(const std::string& name) {
    std::ifstream file(std::filesystem::path(ARMTRUE_REFERENCE_CASES) / (name + ".bin"),
                       std::ios::binary);
    if (!file) throw std::runtime_error(name + ".bin cannot be read");
    data_.assign(std::istreambuf_iterator<char>(file), {});
  }
  template <typename T>
  T next() {
    T value = {};
    EXPECT_LE(at_ + sizeof value, data_.size());
    std::memcpy(&value, &data_[at_], sizeof value);
    at_ += sizeof value;
    return value;
  }
  std::vector<std::uint8_t> bytes(std::size_t count) {
    const auto begin = data_.begin() + static_cast<std::ptrdiff_t>(at_);
    at_ += count;
    return {begin, begin + static_cast<std::ptrdiff_t>(count)};
  }
  bool at_end() const { return at_ == data_.size(); }

 private:
  std::vector<char> data_;
  std::size_t at_ = 0;
};

class ReferenceTest : public ::testing::TestWithParam<Arm> {};

TEST_P(ReferenceTest, Correction_OfAnyPose_IsTheExactInverse) {
  Reader reader(GetParam().file);
  const auto length = static_cast<std::size_t>(reader.next<std::int32_t>());
  const auto joints = static_cast<std::size_t>(reader.next<std::int32_t>());
  const auto sensors = static_cast<std::size_t>(reader.next<std::int32_t>());
  const auto cases = reader.next<std::int32_t>();
  const std::vector<std::uint8_t> image = reader.bytes(length);
  DeviceIdentity device;
  device.joint_count = static_cast<std::uint8_t>(joints);
  ASSERT_TRUE(validate(image, device).accepted());
  const TableView table(image);
  const auto workspace = std::make_unique<Workspace>();
  std::int64_t largest = 0;
  tests::Bytes corrections;
  for (std::int32_t number = 0; number < cases; ++number) {
    JointPositions target;
    for (std::size_t k = 0; k < joints; ++k) target[k] = {reader.next<std::int64_t>()};
    Surroundings around;
    for (std::size_t s = 0; s < sensors; ++s) {
      around.temperature_difference[s] = reader.next<std::int32_t>();
    }
    around.payload = reader.next<std::int32_t>();
    around.time = reader.next<std::int32_t>();
    for (std::size_t k = 0; k < joints; ++k) {
      around.direction[k] = static_cast<std::int8_t>(reader.next<std::int32_t>());
    }
    const Correction correction = solve(table, target, around, *workspace);
    EXPECT_FALSE(correction.is_near_singular || correction.is_outside_coverage ||
                 correction.is_saturated)
        << "case " << number;
    for (std::size_t k = 0; k < joints; ++k) {
      const auto right = reader.next<std::int32_t>();
      largest = std::max<std::int64_t>(largest, std::abs(right));
      tests::append(corrections, correction.delta[k]);
      EXPECT_NEAR(correction.delta[k], right, static_cast<double>(GetParam().permitted))
          << "case " << number << ", joint " << k + 1;
    }
  }
  EXPECT_TRUE(reader.at_end());
  EXPECT_GT(largest, 50 * kRounding) << "there is something to correct";
  EXPECT_EQ(crc32(corrections), GetParam().checksum) << std::hex << crc32(corrections);
}

INSTANTIATE_TEST_SUITE_P(Arms, ReferenceTest, ::testing::ValuesIn(kArms),
                         [](const auto& arm) { return std::string(arm.param.file); });

}  // namespace
}  // namespace armtrue
