// NMT, heartbeat, EMCY, SYNC, PDO configuration and parameters of the whole node.
#include <gtest/gtest.h>

#include <cstdint>
#include <vector>

#include "firmware/testing/node_bench.h"
#include "firmware/testing/test_table.h"

namespace armtrue::canopen {
namespace {

class NetworkTest : public testing::Test {
 protected:
  NetworkTest() : bench(false) {}
  std::vector<CanFrame> sent() { return bench.upstream.take_sent(); }
  std::vector<CanFrame> sent(std::uint32_t id) { return bench.sent(id); }
  void nmt(int command, int node = NodeBench::kNodeId) { bench.nmt(command, node); }
  NmtState state() { return bench.node().nmt_state(); }
  NodeBench bench;
};

TEST_F(NetworkTest, BootsWithOneMessageIntoPreOperational) {
  const std::vector<CanFrame> frames = sent();
  ASSERT_EQ(frames.size(), 1U);
  EXPECT_EQ(frames[0].id, 0x700U + NodeBench::kNodeId);
  EXPECT_EQ(frames[0].len, 1);
  EXPECT_EQ(frames[0].data[0], 0);
  EXPECT_EQ(state(), NmtState::kPreOperational);
}

TEST_F(NetworkTest, ObeysItsOwnAndBroadcastNmtOnly) {
  nmt(1, NodeBench::kNodeId + 1);
  EXPECT_EQ(state(), NmtState::kPreOperational);
  nmt(1, 0);
  EXPECT_EQ(state(), NmtState::kOperational);
  nmt(2);
  EXPECT_EQ(state(), NmtState::kStopped);
  nmt(128);
  EXPECT_EQ(state(), NmtState::kPreOperational);
  nmt(77);
  EXPECT_EQ(state(), NmtState::kPreOperational);
  bench.from_controller(make_frame(0, {1}));
  EXPECT_EQ(state(), NmtState::kPreOperational);
}

TEST_F(NetworkTest, Resets_BootAgainAndRestoreTheirParameters) {
  ASSERT_EQ(bench.write(0x1017, 0, 500, 2), 0U);
  ASSERT_EQ(bench.write(0x2000, 3, 9000, 4), 0U);
  sent();
  nmt(130);
  bench.run_for(1000);
  EXPECT_EQ(sent(0x700U + NodeBench::kNodeId).size(), 1U);
  EXPECT_EQ(bench.read(0x1017, 0), 0U);
  EXPECT_EQ(bench.read(0x2000, 3), 9000U) << "not in the communication area";
  nmt(129);
  EXPECT_EQ(sent(0x700U + NodeBench::kNodeId).size(), 1U);
  EXPECT_EQ(bench.read(0x2000, 3), 20000U);
}

TEST_F(NetworkTest, HeartbeatKeepsItsPeriodAndShowsTheState) {
  ASSERT_EQ(bench.write(0x1017, 0, 100, 2), 0U);
  sent();
  bench.run_for(1'000'000);
  const std::vector<CanFrame> beats = sent(0x700U + NodeBench::kNodeId);
  EXPECT_EQ(beats.size(), 10U);
  EXPECT_EQ(beats.back().data[0], 127);
  nmt(2);
  bench.run_for(100'000);
  EXPECT_EQ(sent(0x700U + NodeBench::kNodeId).back().data[0], 4);
  nmt(1);
  bench.run_for(100'000);
  EXPECT_EQ(sent(0x700U + NodeBench::kNodeId).back().data[0], 5);
}

TEST_F(NetworkTest, ALostHeartbeatLeavesOperationalAndIsReported) {
  ASSERT_EQ(bench.write(0x1016, 1, 0x00050064, 4), 0U);  // node 5, 100 ms
  nmt(1);
  bench.run_for(500'000);
  EXPECT_EQ(state(), NmtState::kOperational) << "watching begins with the first heartbeat";
  bench.from_controller(make_frame(0x705, {5}));
  sent();
  bench.run_for(150'000);
  EXPECT_EQ(state(), NmtState::kPreOperational);
  const std::vector<CanFrame> emcy = sent(0x80U + NodeBench::kNodeId);
  ASSERT_EQ(emcy.size(), 1U);
  EXPECT_EQ(load_le<std::uint16_t>(emcy[0].data), 0x8130);
  EXPECT_EQ(emcy[0].data[3], 5) << "which node";
  bench.from_controller(make_frame(0x705, {5}));
  bench.run_for(1000);
  EXPECT_EQ(load_le<std::uint16_t>(sent(0x80U + NodeBench::kNodeId).at(0).data), 0);
}

TEST_F(NetworkTest, LostHeartbeat_NoLongerWatched_ClearsErrorRegister) {
  ASSERT_EQ(bench.write(0x1016, 1, 0x00050064, 4), 0U);
  ASSERT_EQ(bench.write(0x1016, 2, 0x00060064, 4), 0U);
  bench.from_controller(make_frame(0x705, {5}));
  bench.from_controller(make_frame(0x706, {5}));
  sent();
  bench.run_for(150'000);
  const std::vector<CanFrame> emcy = sent(0x80U + NodeBench::kNodeId);
  ASSERT_EQ(emcy.size(), 2U) << "each lost node";
  EXPECT_EQ(emcy[0].data[3], 5);
  EXPECT_EQ(emcy[1].data[3], 6);
  ASSERT_EQ(bench.write(0x1016, 1, 0, 4), 0U);
  EXPECT_EQ(bench.read(0x1001, 0), 0x11U) << "node 6 is still missing";
  ASSERT_EQ(bench.write(0x1016, 2, 0, 4), 0U);
  EXPECT_EQ(bench.read(0x1001, 0), 0U);
}

TEST_F(NetworkTest, ErrorBehaviourDecidesWhatALostHeartbeatDoes) {
  ASSERT_EQ(bench.write(0x1016, 1, 0x00050064, 4), 0U);
  for (const auto& [behaviour, expected] :
       {std::pair{1U, NmtState::kOperational}, std::pair{2U, NmtState::kStopped}}) {
    nmt(128);
    ASSERT_EQ(bench.write(0x1029, 1, behaviour, 1), 0U);
    nmt(1);
    bench.from_controller(make_frame(0x705, {5}));
    bench.run_for(150'000);
    EXPECT_EQ(state(), expected);
  }
}

TEST_F(NetworkTest, OneNodeIsWatchedInOneSlotOnly) {
  ASSERT_EQ(bench.write(0x1016, 1, 0x00050064, 4), 0U);
  EXPECT_EQ(bench.write(0x1016, 2, 0x000500C8, 4), 0x06040043U);
  EXPECT_EQ(bench.write(0x1016, 2, 0x00800064, 4), 0x06040043U);
  EXPECT_EQ(bench.write(0x1016, 1, 0x000500C8, 4), 0U);
  ASSERT_EQ(bench.write(0x1016, 3, 0x00010064, 4), 0U);
  EXPECT_EQ(bench.write(0x1016, 4, 0x00010064, 4), 0x06040043U) << "node 1 as any other";
  EXPECT_EQ(bench.write(0x1016, 5, 0x007F0064, 4), 0U) << "the last node";
  ASSERT_EQ(bench.write(0x1016, 6, 0x00060000, 4), 0U);
  EXPECT_EQ(bench.write(0x1016, 7, 0x00060064, 4), 0U) << "without a time nobody watches it";
}

TEST_F(NetworkTest, EmcyKeepsItsInhibitTimeAndItsHistory) {
  ASSERT_EQ(bench.write(0x1015, 0, 1000, 2), 0U);  // 100 ms
  ASSERT_EQ(bench.write(0x2000, 6, 100, 4), 0U);
  nmt(1);
  bench.upstream.lose_frames(3);
  bench.upstream.set_state(BusState::kPassive);
  sent();
  bench.run_for(50'000);
  EXPECT_EQ(sent(0x80U + NodeBench::kNodeId).size(), 1U);
  bench.run_for(100'000);
  EXPECT_EQ(sent(0x80U + NodeBench::kNodeId).size(), 1U);
  EXPECT_EQ(bench.read(0x1003, 0), 2U);
  EXPECT_EQ(bench.read(0x1003, 1) & 0xFFFF, 0x8110U) << "the newest first";
  EXPECT_EQ(bench.read(0x1003, 2) & 0xFFFF, 0x8120U);
  EXPECT_EQ(bench.write(0x1003, 0, 1, 1), 0x06090031U);
  EXPECT_EQ(bench.write(0x1003, 0, 0, 1), 0U);
  const auto answer = bench.ask({0x40, 0x03, 0x10, 1, 0, 0, 0, 0});
  EXPECT_EQ(load_le<std::uint32_t>(&answer[4]), 0x08000024U) << "a field without an error";
}

TEST_F(NetworkTest, AShortPdoIsReportedUntilAWholeOneComes) {
  ASSERT_EQ(bench.write(0x1412, 1, 0x191, 4), 0U);
  nmt(1);
  sent();
  for (int k = 0; k < 3; ++k) bench.from_controller(make_frame(0x191, {1}));
  bench.run_for(1000);
  const auto emergencies = sent(0x80U + NodeBench::kNodeId);
  ASSERT_EQ(emergencies.size(), 1U) << "once";
  EXPECT_EQ(load_le<std::uint16_t>(emergencies[0].data), 0x8210);
  EXPECT_EQ(load_le<std::uint16_t>(&emergencies[0].data[3]), 0x191);
  EXPECT_EQ(bench.read(0x1001, 0), 0x11U);
  EXPECT_EQ(bench.read(0x2021, 0), 0U) << "and not taken";
  bench.from_controller(make_frame(0x191, {0, 0, 0, 0, 0, 0, 0, 0}));
  bench.run_for(1000);
  EXPECT_EQ(load_le<std::uint16_t>(sent(0x80U + NodeBench::kNodeId).at(0).data), 0U)
      << "error reset";
  EXPECT_EQ(bench.read(0x1001, 0), 0U);
}

TEST(Mapping, ABusWithoutFdCarriesEightBytes) {
  for (const bool fd : {false, true}) {
    NodeBench bench(true, fd);
    ASSERT_EQ(bench.write(0x1612, 0, 0, 1), 0U);
    for (std::uint8_t k = 1; k <= 3; ++k) {
      ASSERT_EQ(bench.write(0x1612, k, 0x607A0020U + 0x08000000U * (k - 1U), 4), 0U);
    }
    EXPECT_EQ(bench.write(0x1612, 0, 2, 1), 0U);
    ASSERT_EQ(bench.write(0x1612, 0, 0, 1), 0U);
    EXPECT_EQ(bench.write(0x1612, 0, 3, 1), fd ? 0U : 0x06040042U) << "twelve bytes";
  }
}

TEST_F(NetworkTest, EmergenciesMayMoveToAnotherIdentifier) {
  EXPECT_EQ(bench.read(0x1014, 0), 0x80U + NodeBench::kNodeId);
  EXPECT_EQ(bench.write(0x1014, 0, 0x90, 4), 0x06090030U) << "valid: only its validity changes";
  ASSERT_EQ(bench.write(0x1014, 0, 0x80000000U | (0x80U + NodeBench::kNodeId), 4), 0U);
  EXPECT_EQ(bench.write(0x1014, 0, 0xA0000090, 4), 0x06090030U) << "29 bit";
  EXPECT_EQ(bench.write(0x1014, 0, 0x80000601, 4), 0x06090030U) << "SDO's";
  ASSERT_EQ(bench.write(0x1014, 0, 0x80000090, 4), 0U);
  EXPECT_EQ(bench.write(0x1014, 0, 0x601, 4), 0x06090030U) << "SDO's";
  ASSERT_EQ(bench.write(0x1014, 0, 0x90, 4), 0U);
  bench.upstream.lose_frames(1);
  bench.run_for(1000);
  EXPECT_EQ(sent(0x90).size(), 1U);
}

TEST_F(NetworkTest, SyncCounterOverflow_OfOne_IsRefused) {
  EXPECT_EQ(bench.write(0x1019, 0, 1, 1), 0x06090030U) << "reserved";
  EXPECT_EQ(bench.write(0x1019, 0, 2, 1), 0U);
  EXPECT_EQ(bench.write(0x1019, 0, 0, 1), 0U);
}

// SYNC of another length releases no targets: the arm would stop.
TEST_F(NetworkTest, SyncCounterOverflow_WhileJointsAreCommanded_IsRefused) {
  bench.configure(Mode::kOffset);
  bench.command_joints({});
  EXPECT_EQ(bench.write(0x1019, 0, 10, 1), kDeviceState);
  EXPECT_EQ(bench.read(0x1019, 0), 0U);
  bench.run_for(600'000);
  EXPECT_EQ(bench.write(0x1019, 0, 10, 1), 0U);
}

TEST_F(NetworkTest, ObjectsThatCannotBeMapped_AreRefused) {
  EXPECT_EQ(bench.write(0x1612, 0, 0, 1), 0U);
  EXPECT_EQ(bench.write(0x1612, 1, 0x10170010, 4), 0x06040041U) << "writable";
  EXPECT_EQ(bench.write(0x1A08, 0, 0, 1), 0U);
  EXPECT_EQ(bench.write(0x1A08, 1, 0x10000020, 4), 0x06040041U) << "readable";
  EXPECT_EQ(bench.write(0x1612, 1, 0, 4), 0U) << "nothing may be";
}

TEST_F(NetworkTest, SyncMayMoveToAnotherIdentifier) {
  EXPECT_EQ(bench.write(0x1005, 0, 0x40000080, 4), 0x06090030U) << "not a producer";
  EXPECT_EQ(bench.write(0x1005, 0, 0x600, 4), 0U) << "free: only 0x601 to 0x67F are SDO";
  EXPECT_EQ(bench.write(0x1005, 0, 0x601, 4), 0x06090030U);
  EXPECT_EQ(bench.write(0x1005, 0, 0x20000080, 4), 0x06090030U);
}

TEST_F(NetworkTest, TemperaturesComeByRpdoAndGoStale) {
  ASSERT_EQ(bench.write(0x1410, 1, 0x190, 4), 0U);
  ASSERT_EQ(bench.write(0x2000, 6, 1000, 4), 0U);
  nmt(1);
  bench.from_controller(make_frame(0x190, {0xC4, 0x09, 0x9C, 0xFF, 0, 0, 1, 0}));
  EXPECT_EQ(bench.read(0x2020, 1), 2500U);
  EXPECT_EQ(static_cast<std::int16_t>(bench.read(0x2020, 2)), -100);
  sent();
  bench.run_for(1'100'000);
  EXPECT_EQ(load_le<std::uint16_t>(sent(0x80U + NodeBench::kNodeId).at(0).data), 0xFF12);
}

TEST_F(NetworkTest, MappingFollowsTheProcedureOfTheStandard) {
  ASSERT_EQ(bench.write(0x1412, 1, 0x191, 4), 0U);
  EXPECT_EQ(bench.write(0x1612, 0, 0, 1), 0x06010000U) << "valid: switch it off first";
  ASSERT_EQ(bench.write(0x1412, 1, 0x80000191, 4), 0U);
  EXPECT_EQ(bench.write(0x1612, 1, 0x20200110, 4), 0x06010000U) << "mapping in use";
  ASSERT_EQ(bench.write(0x1612, 0, 0, 1), 0U);
  EXPECT_EQ(bench.write(0x1612, 1, 0x10000020, 4), 0x06040041U) << "not mappable";
  EXPECT_EQ(bench.write(0x1612, 1, 0x30000020, 4), 0x06020000U) << "no such object";
  EXPECT_EQ(bench.write(0x1612, 1, 0x20200910, 4), 0x06090011U) << "no such sub-index";
  EXPECT_EQ(bench.write(0x1612, 1, 0x20200120, 4), 0x06040041U) << "wrong length";
  EXPECT_EQ(bench.write(0x1612, 1, 0x20010220, 4), 0x06040041U) << "read-only in an RPDO";
  ASSERT_EQ(bench.write(0x1612, 1, 0x00050008, 4), 0U) << "dummy";
  ASSERT_EQ(bench.write(0x1612, 2, 0x20200110, 4), 0U);
  EXPECT_EQ(bench.write(0x1612, 0, 3, 1), 0x06040041U) << "the third is empty";
  EXPECT_EQ(bench.write(0x1612, 0, 9, 1), 0x06040042U);
  ASSERT_EQ(bench.write(0x1612, 0, 2, 1), 0U);
  ASSERT_EQ(bench.write(0x1412, 1, 0x191, 4), 0U);
  nmt(1);
  bench.from_controller(make_frame(0x191, {0xEE, 0x34, 0x12}));
  EXPECT_EQ(bench.read(0x2020, 1), 0x1234U);
}

TEST_F(NetworkTest, PdoIdentifiersAreChecked) {
  EXPECT_EQ(bench.write(0x1412, 1, 0x20000191, 4), 0x06090030U) << "29 bit";
  EXPECT_EQ(bench.write(0x1412, 1, 0x581, 4), 0x06090030U) << "SDO's";
  EXPECT_EQ(bench.write(0x1412, 1, 0, 4), 0x06090030U) << "NMT's";
  ASSERT_EQ(bench.write(0x1412, 1, 0x191, 4), 0U);
  EXPECT_EQ(bench.write(0x1412, 1, 0x192, 4), 0x06090030U) << "valid: does not move";
  EXPECT_EQ(bench.write(0x1412, 2, 250, 1), 0x06090030U) << "reserved transmission type";
  EXPECT_EQ(bench.write(0x1808, 3, 10, 2), 0U);
  ASSERT_EQ(bench.write(0x1808, 1, 0x400001A8, 4), 0U);
  EXPECT_EQ(bench.write(0x1808, 3, 20, 2), 0x06010000U) << "valid: inhibit time does not change";
}

class StatusTpdoTest : public NetworkTest {
 protected:
  // Maps one object into the ninth TPDO and starts the node.
  void start(std::uint32_t mapped, std::uint32_t inhibit_100us, std::uint32_t event_ms) {
    ASSERT_EQ(bench.write(0x1A08, 0, 0, 1), 0U);
    ASSERT_EQ(bench.write(0x1A08, 1, mapped, 4), 0U);
    ASSERT_EQ(bench.write(0x1A08, 0, 1, 1), 0U);
    ASSERT_EQ(bench.write(0x1808, 3, inhibit_100us, 2), 0U);
    ASSERT_EQ(bench.write(0x1808, 5, event_ms, 2), 0U);
    ASSERT_EQ(bench.write(0x1808, 1, 0x400001A8, 4), 0U);
    sent();
    nmt(1);
  }
  // Milliseconds from one frame to the next; the first left at the start.
  std::vector<std::uint64_t> intervals_ms(std::uint64_t duration_ms) {
    std::vector<std::uint64_t> found;
    EXPECT_EQ(sent(0x1A8).size(), 1U);
    std::uint64_t last_us = bench.now_us;
    const std::uint64_t end_us = bench.now_us + duration_ms * 1000;
    while (bench.now_us < end_us) {
      bench.run_for(1000);
      for (std::size_t frames = sent(0x1A8).size(); frames != 0; --frames) {
        found.push_back((bench.now_us - last_us) / 1000);
        last_us = bench.now_us;
      }
    }
    return found;
  }
};

TEST_F(StatusTpdoTest, InhibitTime_IsTheIntervalOfSteadyChanges) {
  start(0x20010D20, 50, 0);  // 0x2001 sub 13 changes every millisecond
  EXPECT_EQ(intervals_ms(60), std::vector<std::uint64_t>(12, 5));
}

TEST_F(StatusTpdoTest, EventTimer_RepeatsUnchangedValues) {
  start(0x20010C08, 0, 7);  // 0x2001 sub 12, the number of joints
  EXPECT_EQ(intervals_ms(70), std::vector<std::uint64_t>(10, 7));
}

TEST_F(StatusTpdoTest, NoEventTimer_SendsUnchangedValuesOnce) {
  start(0x20010C08, 0, 0);
  EXPECT_TRUE(intervals_ms(300).empty());
}

TEST_F(NetworkTest, TimeSinceStart_IsInMilliseconds) {
  bench.run_for(2'345'000);
  EXPECT_EQ(bench.read(0x2001, 13), bench.now_us / 1000);
}

TEST_F(NetworkTest, SyncStartValueAlignsToTheCounter) {
  const std::pair<std::uint32_t, std::vector<int>> kExpected[] = {
      {0, {2, 4, 6, 8, 10}}, {1, {1, 3, 5, 7, 9}}, {4, {4, 6, 8, 10}}};
  for (const auto& [start, expected] : kExpected) {
    bench.power_on();
    ASSERT_EQ(bench.write(0x1019, 0, 10, 1), 0U);
    ASSERT_EQ(bench.write(0x1808, 6, start, 1), 0U);
    ASSERT_EQ(bench.write(0x1808, 2, 2, 1), 0U);
    ASSERT_EQ(bench.write(0x1808, 1, 0x400001A8, 4), 0U);
    nmt(1);
    sent();
    std::vector<int> with_pdo;
    for (int counter = 1; counter <= 10; ++counter) {
      bench.from_controller(make_frame(0x80, {counter}));
      if (!sent(0x1A8).empty()) with_pdo.push_back(counter);
    }
    EXPECT_EQ(with_pdo, expected) << start;
  }
}

TEST_F(NetworkTest, SavedParameters_SurviveRestart_LoadRestoresDefaults) {
  ASSERT_EQ(bench.write(0x1412, 1, 0x191, 4), 0U);
  ASSERT_EQ(bench.write(0x1017, 0, 250, 2), 0U);
  EXPECT_EQ(bench.write(0x1010, 1, 0x12345678, 4), 0x08000020U);
  ASSERT_EQ(bench.write(0x1010, 1, kSave, 4), 0U);
  EXPECT_EQ(bench.read(0x1010, 1), 1U) << "it saves on command";
  bench.power_on();
  EXPECT_EQ(bench.read(0x1017, 0), 250U);
  EXPECT_EQ(bench.read(0x1412, 1), 0x191U);
  EXPECT_EQ(bench.read(0x1010, 1), 1U);
  ASSERT_EQ(bench.write(0x1011, 1, kLoad, 4), 0U);
  EXPECT_EQ(bench.read(0x1011, 1), 1U);
  EXPECT_EQ(bench.read(0x1017, 0), 250U) << "until the next reset";
  bench.power_on();
  EXPECT_EQ(bench.read(0x1017, 0), 0U);
  bench.parameters.broken = true;
  EXPECT_EQ(bench.write(0x1010, 1, kSave, 4), 0x06060000U);
}

TEST_F(NetworkTest, UnsavedBit_IsSetIfARestartWouldChangeParameters) {
  const auto unsaved = [this] { return (bench.read(0x2001, 2) >> 5 & 1U) != 0; };
  EXPECT_FALSE(unsaved()) << "as delivered";
  ASSERT_EQ(bench.write(0x2021, 0, 5000, 4), 0U);
  EXPECT_FALSE(unsaved()) << "an input is no parameter";
  EXPECT_NE(bench.write(0x2000, 3, 1, 4), 0U);
  EXPECT_FALSE(unsaved()) << "refused";
  ASSERT_EQ(bench.write(0x2000, 3, 30'000, 4), 0U);
  EXPECT_TRUE(unsaved());
  bench.parameters.broken = true;
  EXPECT_NE(bench.write(0x1010, 1, kSave, 4), 0U);
  EXPECT_TRUE(unsaved());
  bench.parameters.broken = false;
  ASSERT_EQ(bench.write(0x1010, 1, kSave, 4), 0U);
  EXPECT_FALSE(unsaved());
  bench.power_on();
  EXPECT_EQ(bench.read(0x2000, 3), 30'000U);
  EXPECT_FALSE(unsaved());
  ASSERT_EQ(bench.write(0x1011, 1, kLoad, 4), 0U);
  EXPECT_TRUE(unsaved()) << "the next start is one as delivered";
}

TEST_F(NetworkTest, InlineNeedsASecondBus) { EXPECT_EQ(bench.write(0x2000, 1, 1, 1), 0x06040043U); }

}  // namespace
}  // namespace armtrue::canopen
