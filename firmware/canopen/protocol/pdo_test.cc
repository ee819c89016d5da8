// What PDO records may hold, written by SDO and found in saved parameters.
#include "firmware/canopen/protocol/pdo.h"

#include <gtest/gtest.h>

namespace armtrue::canopen {
namespace {

class PdoRecordTest : public testing::Test {
 protected:
  PdoRecordTest() { dictionary.restore_defaults(0x20); }

  Abort write(std::uint16_t index, std::uint8_t sub, std::uint32_t value,
              std::size_t payload = kClassicPayload) {
    const std::optional<od::Entry> entry = dictionary.find(index, sub);
    std::array<std::uint8_t, 4> bytes = {};
    store_le(bytes.data(), value);
    const auto content = std::span<const std::uint8_t>(bytes).first(entry->size);
    const Abort abort = check_pdo_write(dictionary, *entry, content, payload);
    if (abort == Abort::kNone) dictionary.assign(*entry, content);
    return abort;
  }
  // As saved parameters come: unchecked.
  void save(std::uint16_t index, std::uint8_t sub, std::uint32_t value) {
    const std::optional<od::Entry> entry = dictionary.find(index, sub);
    std::array<std::uint8_t, 4> bytes = {};
    store_le(bytes.data(), value);
    dictionary.assign(*entry, std::span<const std::uint8_t>(bytes).first(entry->size));
  }

  ObjectDictionary dictionary;
};

constexpr std::uint16_t kRpdo = 0x1412;
constexpr std::uint16_t kTpdo = 0x1808;

TEST_F(PdoRecordTest, CobId_WithBitsOfAnExtendedIdentifier_IsRefused) {
  for (int bit = 11; bit <= 28; ++bit) {
    const std::uint32_t id = 0x191U | 1U << bit;
    EXPECT_EQ(write(kRpdo, 1, id), Abort::kValueRange) << bit;
    EXPECT_EQ(write(kRpdo, 1, 0x80000000U | id), Abort::kValueRange) << bit;
    EXPECT_EQ(write(kTpdo, 1, 0x40000000U | id), Abort::kValueRange) << bit;
  }
  EXPECT_EQ(write(kRpdo, 1, 0x191), Abort::kNone);
}

TEST_F(PdoRecordTest, CobId_SavedWithSuchBits_MakesNoPdo) {
  PdoTable pdos(dictionary, kClassicPayload);
  save(kRpdo, 1, 0x191);
  save(kTpdo, 1, 0x1A1);
  pdos.refresh();
  ASSERT_TRUE(pdos.rpdo(kRpdo - 0x1400).valid);
  ASSERT_TRUE(pdos.tpdo(kTpdo - 0x1800).valid);
  save(kRpdo, 1, 0x191 | 1U << 11);
  save(kTpdo, 1, 0x1A1 | 1U << 28);
  pdos.refresh();
  EXPECT_FALSE(pdos.rpdo(kRpdo - 0x1400).valid);
  EXPECT_FALSE(pdos.tpdo(kTpdo - 0x1800).valid);
}

TEST_F(PdoRecordTest, SavedMapping_LongerThanAFrame_EndsWhereTheFrameDoes) {
  // Three words of 32 bits where a classic frame has room for two; a fourth of 8 would fit again.
  const std::uint16_t mapping = kRpdo + 0x200;
  for (std::uint8_t sub = 1; sub <= 3; ++sub) save(mapping, sub, 0x20210020);
  save(mapping, 4, 0x00050008);
  save(mapping, 0, 4);
  save(kRpdo, 1, 0x191);
  for (const auto& [payload, count, length] :
       {std::tuple{kClassicPayload, 2, 8}, std::tuple{kFdPayload, 4, 13}}) {
    PdoTable pdos(dictionary, payload);
    pdos.refresh();
    const Mapping& decoded = pdos.rpdo(kRpdo - 0x1400).mapping;
    EXPECT_EQ(decoded.count, count);
    EXPECT_EQ(decoded.length, length);
  }
}

TEST_F(PdoRecordTest, SavedMapping_OfWhatMayNotBeMapped_EndsThere) {
  const std::uint16_t mapping = kRpdo + 0x200;
  save(mapping, 1, 0x20210020);
  save(mapping, 2, 0x10180420);  // the serial number: read only
  save(mapping, 3, 0x20210020);
  save(mapping, 0, 3);
  save(kRpdo, 1, 0x191);
  PdoTable pdos(dictionary, kClassicPayload);
  pdos.refresh();
  EXPECT_EQ(pdos.rpdo(kRpdo - 0x1400).mapping.count, 1);
}

TEST_F(PdoRecordTest, SavedCount_BeyondTheRecord_IsCut) {
  const std::uint16_t mapping = kRpdo + 0x200;
  for (std::uint8_t sub = 1; sub <= 8; ++sub) save(mapping, sub, 0x00050008);
  save(mapping, 0, 255);
  PdoTable pdos(dictionary, kFdPayload);
  pdos.refresh();
  EXPECT_EQ(pdos.rpdo(kRpdo - 0x1400).mapping.count, kMappedMax);
}

}  // namespace
}  // namespace armtrue::canopen
