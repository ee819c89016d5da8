// Valid contents of PDO records, written by SDO or loaded from saved parameters.
#include "firmware/canopen/protocol/pdo.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <set>
#include <utility>
#include <vector>

#include "firmware/canopen/protocol/cob_id.h"

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
  // Unchecked, as saved parameters are loaded.
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

TEST_F(PdoRecordTest, FirstAndLastRecord_AreCheckedLikeTheOthers) {
  for (const std::uint16_t record : {std::uint16_t{0x1400}, std::uint16_t{0x1400 + kRpdos - 1},
                                     std::uint16_t{0x1800}, std::uint16_t{0x1800 + kTpdos - 1}}) {
    EXPECT_EQ(write(record, 1, 0xC0000191U | 1U << 11), Abort::kValueRange) << std::hex << record;
  }
}

TEST_F(PdoRecordTest, Mapping_OfMoreBytesThanAFrame_IsRefused) {
  const std::uint16_t mapping = kRpdo + 0x200;
  ASSERT_EQ(write(mapping, 0, 0), Abort::kNone);
  ASSERT_EQ(write(mapping, 1, 0x20210020), Abort::kNone);
  ASSERT_EQ(write(mapping, 2, 0x20210020), Abort::kNone);
  ASSERT_EQ(write(mapping, 3, 0x00050008), Abort::kNone);
  EXPECT_EQ(write(mapping, 0, 3), Abort::kPdoLength) << "nine bytes";
  EXPECT_EQ(write(mapping, 0, 2), Abort::kNone) << "eight";
}

TEST_F(PdoRecordTest, SavedCobId_WithExtendedBits_MakesNoPdo) {
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

TEST_F(PdoRecordTest, SavedCobId_ThatIsTaken_MakesNoPdo) {
  const auto map_payload = [this](std::uint16_t mapping) {
    save(mapping, 1, 0x20210020);
    save(mapping, 0, 1);
  };
  map_payload(0x1610);
  map_payload(0x1612);
  map_payload(0x1A07);
  map_payload(0x1A08);
  save(0x1410, 1, 0x191);
  save(0x1412, 1, 0x191);
  save(0x1807, 1, 0x1A1);
  save(0x1808, 1, 0x1A1);
  PdoTable pdos(dictionary, kClassicPayload);
  pdos.refresh();
  EXPECT_TRUE(pdos.rpdo(16).valid);
  EXPECT_FALSE(pdos.rpdo(18).valid) << "RPDO 17 has it";
  EXPECT_TRUE(pdos.tpdo(7).valid);
  EXPECT_FALSE(pdos.tpdo(8).valid);
  save(0x1808, 1, 0x191);
  save(0x1410, 1, 0x80);
  pdos.refresh();
  EXPECT_FALSE(pdos.rpdo(16).valid) << "that of SYNC";
  EXPECT_TRUE(pdos.rpdo(18).valid);
  EXPECT_FALSE(pdos.tpdo(8).valid) << "RPDO 19 has it";
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

TEST_F(PdoRecordTest, SavedMapping_EndsBeforeAnObjectThatIsNotMappable) {
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

TEST(CobId, Restricted_AreThoseOfTheStandard) {
  // CiA 301, table 41.
  const std::vector<std::pair<std::uint32_t, std::uint32_t>> kRanges = {
      {0x000, 0x07F}, {0x101, 0x180}, {0x581, 0x5FF},
      {0x601, 0x67F}, {0x6E0, 0x6FF}, {0x701, 0x7FF}};
  for (std::uint32_t id = 0; id <= 0x7FF; ++id) {
    const bool listed = std::ranges::any_of(
        kRanges, [id](const auto& range) { return id >= range.first && id <= range.second; });
    EXPECT_EQ(is_restricted_id(id), listed) << std::hex << id;
  }
}

TEST(FdLength, ValidOnes_AreThoseOfTheStandard) {
  const std::set<std::size_t> kValid = {0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20, 24, 32, 48, 64};
  for (std::size_t length = 0; length <= 100; ++length) {
    EXPECT_EQ(is_valid_fd_length(length), kValid.contains(length)) << length;
  }
}

TEST_F(PdoRecordTest, TargetAndActualPosition_CannotShareAFrame) {
  const std::uint16_t mapping = kRpdo + 0x200;
  for (const auto& [first, second] :
       {std::pair{0x607A0020U, 0x60640020U}, {0x60640020U, 0x687A0020U}}) {
    EXPECT_EQ(write(kRpdo, 1, 0x80000191U), Abort::kNone);
    EXPECT_EQ(write(mapping, 0, 0), Abort::kNone);
    EXPECT_EQ(write(mapping, 1, first), Abort::kNone);
    EXPECT_EQ(write(mapping, 2, second), Abort::kNone);
    EXPECT_EQ(write(mapping, 0, 2), Abort::kNotMappable);
    save(mapping, 0, 2);
    save(kRpdo, 1, 0x191);
    PdoTable pdos(dictionary, kClassicPayload);
    pdos.refresh();
    EXPECT_EQ(pdos.rpdo(kRpdo - 0x1400).mapping.count, 1) << "a saved mapping ends before it";
  }
}

TEST_F(PdoRecordTest, TransmissionTypes_UpTo240AreSynchronous) {
  PdoTable pdos(dictionary, kClassicPayload);
  for (const auto& [type, synchronous] :
       {std::pair{0, true}, {1, true}, {240, true}, {254, false}, {255, false}}) {
    EXPECT_EQ(write(kRpdo, 2, static_cast<std::uint32_t>(type)), Abort::kNone) << type;
    pdos.refresh();
    EXPECT_EQ(pdos.rpdo(kRpdo - 0x1400).is_synchronous(), synchronous) << type;
  }
  for (const std::uint32_t type : {241U, 253U}) {
    EXPECT_EQ(write(kRpdo, 2, type), Abort::kValueRange) << type;
  }
}

TEST_F(PdoRecordTest, DummyEntries_WriteNothing) {
  const std::uint16_t mapping = kRpdo + 0x200;
  save(mapping, 1, 0x00070020);
  save(mapping, 2, 0x20210020);
  save(mapping, 0, 2);
  save(kRpdo, 1, 0x191);
  PdoTable pdos(dictionary, kClassicPayload);
  pdos.refresh();
  std::array<std::uint8_t, od::kImageSize> before = {};
  dictionary.copy_out(0, before);
  CanFrame frame;
  frame.len = 8;
  std::ranges::fill(frame.data, std::uint8_t{0xAB});
  EXPECT_EQ(apply_rpdo(dictionary, pdos.rpdo(kRpdo - 0x1400), frame).beyond, 0x2021)
      << "more than a payload can be";
  EXPECT_EQ(dictionary.get(od::kPayloadMass), 0U);
  store_le(&frame.data[4], 1'234'567U);
  EXPECT_EQ(apply_rpdo(dictionary, pdos.rpdo(kRpdo - 0x1400), frame).beyond, 0);
  EXPECT_EQ(dictionary.get(od::kPayloadMass), 1'234'567U);
  dictionary.set(od::kPayloadMass, 0);
  std::array<std::uint8_t, od::kImageSize> after = {};
  dictionary.copy_out(0, after);
  EXPECT_EQ(after, before);
}

TEST_F(PdoRecordTest, CobIdInUse_KeepsItsIdentifier) {
  ASSERT_EQ(write(kRpdo, 1, 0x191), Abort::kNone);
  EXPECT_EQ(write(kRpdo, 1, 0x192), Abort::kValueRange);
  EXPECT_EQ(write(kRpdo, 1, 0x191), Abort::kNone) << "the same again";
  EXPECT_EQ(write(kRpdo, 1, 0x80000192), Abort::kNone) << "switched off, it may move";
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
