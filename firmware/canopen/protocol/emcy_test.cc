// Error register and emergency messages where one condition has several sources.
#include "firmware/canopen/protocol/emcy.h"

#include <gtest/gtest.h>

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

TEST_F(EmcyTest, Condition_StaysUntilItsLastSourceIsWell) {
  emcy.raise(Condition::kTemperatureStale, 1, 0);
  emcy.raise(Condition::kTemperatureStale, 2, 1);
  codes();
  emcy.clear(Condition::kTemperatureStale, 1);
  EXPECT_TRUE(emcy.is_raised(Condition::kTemperatureStale));
  EXPECT_EQ(error_register(), 0x21);
  EXPECT_TRUE(codes().empty());
  emcy.clear(Condition::kTemperatureStale, 1);
  EXPECT_TRUE(emcy.is_raised(Condition::kTemperatureStale));
  emcy.clear(Condition::kTemperatureStale, 0);
  EXPECT_FALSE(emcy.is_raised(Condition::kTemperatureStale));
  EXPECT_EQ(error_register(), 0);
  EXPECT_EQ(codes(), std::vector{0});
}

TEST_F(EmcyTest, Register_IsWhatAllConditionsTogetherSay) {
  emcy.raise(Condition::kTableRefused, 1);
  EXPECT_EQ(error_register(), 0x21);
  emcy.raise(Condition::kBusPassive, 0);
  EXPECT_EQ(error_register(), 0x31);
  emcy.clear(Condition::kTableRefused);
  EXPECT_EQ(error_register(), 0x11);
  emcy.clear(Condition::kBusPassive);
  EXPECT_EQ(error_register(), 0);
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

TEST_F(EmcyTest, InvalidCobId_DropsWhatWaits) {
  emcy.raise(Condition::kStorage, 1);
  dictionary.set(od::kCOBIDEMCY, 0x800000A0U);
  EXPECT_TRUE(codes().empty());
  dictionary.set(od::kCOBIDEMCY, 0xA0U);
  EXPECT_TRUE(codes().empty()) << "it is not kept for later";
}

TEST_F(EmcyTest, FullQueue_KeepsTheOldestAndTheHistoryTheNewest) {
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
  EXPECT_FALSE(emcy.is_raised(Condition::kStorage));
  EXPECT_EQ(error_register(), 0);
  EXPECT_TRUE(codes().empty());
  emcy.raise(Condition::kStorage, 1, 3);
  EXPECT_EQ(codes(), std::vector{0x5530});
}

}  // namespace
}  // namespace armtrue::canopen
