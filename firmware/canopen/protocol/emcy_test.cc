// Error register, history and emergency messages, also of conditions with several sources.
#include "firmware/canopen/protocol/emcy.h"

#include <gtest/gtest.h>

#include <array>
#include <utility>
#include <vector>

#include "firmware/testing/simulated_port.h"

namespace armtrue::canopen {
namespace {

class EmcyTest : public testing::Test {
 protected:
  EmcyTest() : port(false), emcy(dictionary) {
    dictionary.restore_defaults(0x20);
    emcy.reset();
  }
  std::uint8_t error_register() const { return dictionary.get(od::kErrorRegister); }
  // Codes of the messages that leave now.
  std::vector<int> codes(std::uint64_t now_us = 0) {
    emcy.process(port, now_us);
    std::vector<int> result;
    for (const CanFrame& frame : port.take_sent()) {
      result.push_back(load_le<std::uint16_t>(frame.data));
    }
    return result;
  }

  ObjectDictionary dictionary;
  SimulatedPort port;
  Emcy emcy;
};

TEST_F(EmcyTest, SecondSource_OfACondition_IsReportedToo) {
  emcy.raise(Condition::kHeartbeatLost, 5, 0);
  emcy.raise(Condition::kHeartbeatLost, 6, 1);
  emcy.raise(Condition::kHeartbeatLost, 6, 1);
  EXPECT_EQ(codes(), (std::vector{0x8130, 0x8130}));
  EXPECT_EQ(dictionary.get(od::kPreDefinedErrorFieldCount), 2);
}

TEST_F(EmcyTest, Condition_StaysUntilItsLastSourceIsCleared) {
  emcy.raise(Condition::kInputSilent, 1, 0);
  emcy.raise(Condition::kInputSilent, 2, 1);
  codes();
  emcy.clear(Condition::kInputSilent, 1);
  EXPECT_EQ(error_register(), 0x21);
  EXPECT_TRUE(codes().empty());
  emcy.clear(Condition::kInputSilent, 1);
  EXPECT_EQ(error_register(), 0x21);
  emcy.clear(Condition::kInputSilent, 0);
  EXPECT_EQ(error_register(), 0);
  EXPECT_EQ(codes(), std::vector{0});
}

TEST_F(EmcyTest, ErrorRegister_CombinesAllConditions) {
  emcy.raise(Condition::kTableRefused, 1);
  EXPECT_EQ(error_register(), 0x21);
  emcy.raise(Condition::kBusPassive, 0);
  EXPECT_EQ(error_register(), 0x31);
  emcy.clear(Condition::kTableRefused);
  EXPECT_EQ(error_register(), 0x11);
  emcy.clear(Condition::kBusPassive);
  EXPECT_EQ(error_register(), 0);
}

TEST_F(EmcyTest, EachCondition_HasItsCodeAndItsBits) {
  // docs/protocol.md; the order is that of Condition.
  constexpr std::array<std::pair<int, int>, static_cast<std::size_t>(Condition::kCount)> kExpected =
      {{{0xFF10, 0x11},
        {0xFF11, 0x21},
        {0xFF12, 0x21},
        {0xFF13, 0x21},
        {0xFF14, 0x11},
        {0x5530, 0x21},
        {0x8130, 0x11},
        {0x8110, 0x11},
        {0x8120, 0x11},
        {0x8140, 0x11},
        {0x8140, 0x11},
        {0x8210, 0x11},
        {0x8240, 0x11},
        {0xFF15, 0x11},
        {0xFF16, 0x21},
        {0xFF17, 0x21},
        {0xFF18, 0x21}}};
  for (std::size_t k = 0; k < kExpected.size(); ++k) {
    emcy.raise(static_cast<Condition>(k), 0x01020304);
    emcy.process(port, 0);
    const std::vector<CanFrame> sent = port.take_sent();
    ASSERT_EQ(sent.size(), 1U) << k;
    EXPECT_EQ(load_le<std::uint16_t>(sent[0].data), kExpected[k].first) << k;
    EXPECT_EQ(sent[0].data[2], kExpected[k].second) << k;
    EXPECT_EQ(load_le<std::uint32_t>(&sent[0].data[3]), 0x01020304U);
    EXPECT_EQ(sent[0].data[7], 0);
    emcy.clear(static_cast<Condition>(k));
    emcy.process(port, 0);
    EXPECT_EQ(load_le<std::uint16_t>(&port.take_sent().at(0).data[3]), kExpected[k].first)
        << "the end of which";
  }
}

TEST_F(EmcyTest, FullHistory_KeepsTheNewestErrors) {
  constexpr std::size_t kFields = std::size(od::kPreDefinedErrorField);
  for (std::uint32_t k = 1; k <= kFields + 2; ++k) {
    emcy.raise(Condition::kTableRefused, k);
    emcy.clear(Condition::kTableRefused);
  }
  EXPECT_EQ(dictionary.get(od::kPreDefinedErrorFieldCount), kFields);
  for (std::size_t k = 0; k < kFields; ++k) {
    EXPECT_EQ(dictionary.get(od::kPreDefinedErrorField[k]) >> 16, kFields + 2 - k) << k;
  }
}

TEST_F(EmcyTest, Reset_ClearsHistoryMessagesAndInhibitTime) {
  dictionary.set(od::kInhibitTimeEMCY, std::uint16_t{1000});
  emcy.raise(Condition::kTableRefused, 1);
  ASSERT_EQ(codes(0).size(), 1U);
  emcy.raise(Condition::kStorage, 1);
  emcy.reset();
  EXPECT_EQ(error_register(), 0);
  EXPECT_EQ(dictionary.get(od::kPreDefinedErrorFieldCount), 0);
  EXPECT_EQ(dictionary.get(od::kPreDefinedErrorField[0]), 0U);
  EXPECT_TRUE(codes(1'000'000).empty());
  emcy.raise(Condition::kStorage, 1);
  EXPECT_EQ(codes(0), std::vector{0x5530}) << "the inhibit time begins anew as well";
}

TEST_F(EmcyTest, InhibitTime_KeepsMessagesApart) {
  dictionary.set(od::kInhibitTimeEMCY, std::uint16_t{30});  // 3 ms
  emcy.raise(Condition::kTableRefused, 1);
  emcy.raise(Condition::kStorage, 1);
  emcy.raise(Condition::kBusPassive, 0);
  EXPECT_EQ(codes(10'000).size(), 1U);
  EXPECT_EQ(codes(12'999).size(), 0U);
  EXPECT_EQ(codes(13'000).size(), 1U);
  EXPECT_EQ(codes(15'999).size(), 0U);
  EXPECT_EQ(codes(16'000).size(), 1U);
}

TEST_F(EmcyTest, InvalidCobId_DropsQueuedMessages) {
  emcy.raise(Condition::kStorage, 1);
  dictionary.set(od::kCOBIDEMCY, 0x800000A0U);
  EXPECT_TRUE(codes().empty());
  dictionary.set(od::kCOBIDEMCY, 0xA0U);
  EXPECT_TRUE(codes().empty()) << "it is not kept for later";
}

TEST_F(EmcyTest, FullQueue_KeepsTheOldest_HistoryKeepsTheNewest) {
  for (int round = 0; round < 20; ++round) {
    emcy.raise(Condition::kStorage, static_cast<std::uint32_t>(round));
    emcy.clear(Condition::kStorage);
  }
  EXPECT_EQ(codes().size(), 16U);
  EXPECT_EQ(dictionary.get(od::kPreDefinedErrorField[0]), 0x00135530U);
  emcy.clear_history();
  EXPECT_EQ(dictionary.get(od::kPreDefinedErrorFieldCount), 0);
  EXPECT_EQ(dictionary.get(od::kPreDefinedErrorField[0]), 0U);
}

TEST_F(EmcyTest, Reset_ForgetsConditionsAndMessages) {
  emcy.raise(Condition::kStorage, 1, 3);
  emcy.reset();
  EXPECT_EQ(error_register(), 0);
  EXPECT_TRUE(codes().empty());
  emcy.raise(Condition::kStorage, 1, 3);
  EXPECT_EQ(codes(), std::vector{0x5530});
}

}  // namespace
}  // namespace armtrue::canopen
