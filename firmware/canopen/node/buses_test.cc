// Bus states, counters and overruns that the node reports, and its self-test (0x2030).
#include <gtest/gtest.h>

#include <cstdint>
#include <vector>

#include "firmware/testing/node_bench.h"
#include "firmware/testing/test_table.h"

namespace armtrue::canopen {
namespace {

class BusTest : public testing::Test {
 protected:
  std::vector<CanFrame> sent() { return bench.upstream.take_sent(); }
  std::vector<CanFrame> sent(std::uint32_t id) { return bench.sent(id); }
  NodeBench bench{false};
};

TEST(TwoBuses, PassiveOnBoth_StaysRaisedUntilBothAreActive) {
  NodeBench bench;
  bench.upstream.set_state(BusState::kPassive);
  bench.downstream.set_state(BusState::kPassive);
  bench.run_for(1000);
  EXPECT_EQ(bench.read(0x1001, 0), 0x11U);
  bench.upstream.set_state(BusState::kActive);
  bench.run_for(1000);
  EXPECT_EQ(bench.read(0x1001, 0), 0x11U) << "the drives' bus is still passive";
  bench.downstream.set_state(BusState::kActive);
  bench.run_for(1000);
  EXPECT_EQ(bench.read(0x1001, 0), 0U);
}

TEST(BusStatus, Counters_AreThoseOfTheirOwnBus) {
  NodeBench bench;
  const std::uint32_t taken = bench.read(0x2002, 2);  // this request and all before
  const std::uint32_t back = bench.read(0x2003, 2);
  for (int k = 0; k < 3; ++k) bench.from_controller(make_frame(0x123, {k}));
  for (int k = 0; k < 2; ++k) bench.from_drives(make_frame(0x124, {k}));
  bench.upstream.lose_frames(7);
  bench.downstream.lose_frames(8);
  EXPECT_EQ(bench.read(0x2002, 2), taken + 3 + 2) << "and the two requests";
  EXPECT_EQ(bench.read(0x2003, 2), back + 2);
  EXPECT_EQ(bench.read(0x2002, 7), 3U) << "forwarded from here";
  EXPECT_EQ(bench.read(0x2003, 7), 2U);
  EXPECT_EQ(bench.read(0x2003, 3), 3U) << "sent";
  EXPECT_EQ(bench.read(0x2002, 4), 7U) << "overruns";
  EXPECT_EQ(bench.read(0x2003, 4), 8U);
  bench.downstream.set_room(0);
  bench.downstream.take_sent();
  bench.from_controller(make_frame(0x123, {9}));
  EXPECT_EQ(bench.read(0x2003, 5), 1U) << "refused";
  EXPECT_EQ(bench.read(0x2002, 8), 1U) << "dropped in forwarding";
  EXPECT_EQ(bench.read(0x2003, 8), 0U);
  bench.downstream.set_state(BusState::kPassive);
  EXPECT_EQ(bench.read(0x2003, 1), 2U);
  EXPECT_EQ(bench.read(0x2002, 1), 0U);
  bench.downstream.set_state(BusState::kBusOff);
  EXPECT_EQ(bench.read(0x2003, 1), 3U);
  EXPECT_EQ(bench.read(0x2003, 6), 1U) << "entries";
  EXPECT_EQ(bench.read(0x2002, 6), 0U);
}

TEST_F(BusTest, BusOffIsRecoveredAfterAPauseAndReported) {
  bench.run_for(1000);
  sent();
  bench.upstream.set_state(BusState::kBusOff);
  bench.run_for(BusWatch::kRecoveryPauseUs - 5000);
  EXPECT_EQ(bench.upstream.recoveries(), 0U);
  bench.run_for(10'000);
  EXPECT_EQ(bench.upstream.recoveries(), 1U);
  const std::vector<CanFrame> emcy = sent(0x80U + NodeBench::kNodeId);
  ASSERT_EQ(emcy.size(), 2U);
  EXPECT_EQ(load_le<std::uint16_t>(emcy[0].data), 0x8140);
  EXPECT_EQ(load_le<std::uint16_t>(emcy[1].data), 0x0000);
}

TEST_F(BusTest, BusOffAgainBeforeTheNextTurn_IsRecoveredAgain) {
  bench.run_for(1000);
  bench.upstream.set_state(BusState::kBusOff);
  while (bench.upstream.recoveries() == 0) bench.run_for(1000);
  bench.upstream.set_state(BusState::kBusOff);
  bench.run_for(2 * BusWatch::kRecoveryPauseUs);
  EXPECT_EQ(bench.upstream.recoveries(), 2U);
  EXPECT_EQ(bench.upstream.bus_state(), BusState::kActive);
}

TEST_F(BusTest, BusOffBetweenTwoTurns_IsReported) {
  bench.run_for(1000);
  sent();
  bench.upstream.set_state(BusState::kBusOff);
  bench.upstream.set_state(BusState::kActive);
  bench.run_for(10'000);
  const std::vector<CanFrame> emcy = sent(0x80U + NodeBench::kNodeId);
  ASSERT_EQ(emcy.size(), 2U);
  EXPECT_EQ(load_le<std::uint16_t>(emcy[0].data), 0x8140);
  EXPECT_EQ(load_le<std::uint16_t>(emcy[1].data), 0x0000);
}

TEST_F(BusTest, PortCountsFromBeforeTheRestart_AreNotReported) {
  bench.upstream.lose_frames(3);
  bench.upstream.set_state(BusState::kBusOff);
  bench.upstream.set_state(BusState::kActive);
  bench.power_on();
  sent();
  bench.run_for(10'000);
  EXPECT_TRUE(sent(0x80U + NodeBench::kNodeId).empty());
}

TEST_F(BusTest, ReadInTheTurnOfABusChange_ShowsTheNewState) {
  bench.run_for(1000);
  bench.upstream.set_state(BusState::kPassive);
  EXPECT_EQ(bench.read(0x1001, 0), 0x11U);
  EXPECT_EQ(bench.read(0x1003, 1) & 0xFFFF, 0x8120U);
  bench.upstream.set_state(BusState::kActive);
  EXPECT_EQ(bench.read(0x1001, 0), 0U);
}

TEST_F(BusTest, PassiveBusEmergency_HasNoFurtherInformation) {
  bench.run_for(1000);
  sent();
  bench.upstream.set_state(BusState::kPassive);
  bench.run_for(1000);
  const std::vector<CanFrame> emcy = sent(0x80U + NodeBench::kNodeId);
  ASSERT_EQ(emcy.size(), 1U);
  EXPECT_EQ(load_le<std::uint32_t>(&emcy[0].data[3]), 0U);
}

TEST_F(BusTest, OverrunError_EndsAfterASecondWithoutOverruns) {
  bench.upstream.lose_frames(3);
  bench.run_for(500'000);
  EXPECT_EQ(bench.read(0x1003, 1), 0x00038110U) << "how many were lost";
  bench.upstream.lose_frames(1);
  bench.run_for(0);
  bench.run_for(999'999);
  EXPECT_EQ(bench.read(0x1001, 0), 0x11U);
  bench.run_for(1);
  EXPECT_EQ(bench.read(0x1001, 0), 0U);
}

TEST(TwoBuses, OverrunsOfEachBus_EndIndependently) {
  NodeBench bench;
  bench.upstream.lose_frames(1);
  bench.run_for(600'000);
  bench.downstream.lose_frames(1);
  bench.run_for(600'000);
  EXPECT_EQ(bench.read(0x1001, 0), 0x11U) << "the drives' bus lost one since";
  EXPECT_EQ(bench.read(0x1003, 0), 2U) << "each was reported";
  bench.run_for(600'000);
  EXPECT_EQ(bench.read(0x1001, 0), 0U);
}

TEST_F(BusTest, EachSelfTest_CanRunAlone) {
  for (std::uint32_t test = 1; test <= 0x10; test <<= 1U) {
    EXPECT_EQ(bench.write(0x2030, 1, test, 1), 0U) << test;
  }
  EXPECT_EQ(bench.write(0x2030, 1, 0, 1), 0x06090030U);
  EXPECT_EQ(bench.write(0x2030, 1, 0x20, 1), 0x06090030U);
}

// The parts of the self-test that can be made to fail from outside, each alone.
class SelfTestTest : public testing::Test {
 protected:
  static constexpr std::uint32_t kTable = 1U << 2;
  static constexpr std::uint32_t kBuses = 1U << 3;
  static constexpr std::uint32_t kPassThrough = 1U << 4;

  std::uint32_t failed(std::uint32_t tests = 0x1F) {
    EXPECT_EQ(bench.write(0x2030, 1, tests, 1), 0U);
    EXPECT_EQ(bench.read(0x2030, 2), tests);
    return bench.read(0x2030, 3);
  }
  NodeBench bench;
};

TEST_F(SelfTestTest, TableCorruptedInMemory_Fails) {
  const std::vector<std::uint8_t> image = TestTable{}.image();
  bench.install(image);
  EXPECT_EQ(failed(), 0U);
  bench.spoil_tables(image.size() - 1);
  EXPECT_EQ(failed(), kTable);
  EXPECT_EQ(failed(0x1F & ~kTable), 0U) << "not asked for";
  bench.power_on();
  EXPECT_EQ(failed(), 0U) << "the one in flash is whole";
}

TEST_F(SelfTestTest, BusOff_Fails) {
  bench.downstream.set_state(BusState::kBusOff);
  EXPECT_EQ(failed(), kBuses);
  EXPECT_EQ(failed(0x1F & ~kBuses), 0U);
  bench.run_for(200'000);
  EXPECT_EQ(failed(), 0U);
  bench.upstream.set_state(BusState::kBusOff);
  bench.from_controller(make_frame(0x620, {0x2F, 0x30, 0x20, 1, 0x1F, 0, 0, 0}));
  bench.run_for(200'000);
  bench.upstream.take_sent();
  EXPECT_EQ(bench.read(0x2030, 3), kBuses) << "of the run while it was off";
}

TEST_F(SelfTestTest, OffsetWithoutATable_Fails) {
  for (std::size_t axis = 0; axis < 6; ++axis) {
    const od::Ref<std::int32_t> offset = od::axis::kPositionOffset[axis];
    auto& dictionary = const_cast<ObjectDictionary&>(bench.node().dictionary());
    dictionary.set(offset, -1);
    EXPECT_EQ(failed(), kPassThrough) << axis;
    EXPECT_EQ(failed(0x1F & ~kPassThrough), 0U);
    dictionary.set(offset, 0);
    EXPECT_EQ(failed(), 0U);
  }
  auto& dictionary = const_cast<ObjectDictionary&>(bench.node().dictionary());
  dictionary.set(od::axis::kPositionOffset[6], -1);
  EXPECT_EQ(failed(), 0U) << "this device has six joints";
}

}  // namespace
}  // namespace armtrue::canopen
