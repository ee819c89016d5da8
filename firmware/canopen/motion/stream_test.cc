// Streams of targets that fail, end or wait: emergencies raised and corrections undone.
#include <gtest/gtest.h>

#include "firmware/testing/drives_bench.h"

namespace armtrue::canopen {
namespace {

// Reasons why sets do not go out: information of emergency 0xFF15 (docs/protocol.md).
constexpr std::uint32_t kFramesMissing = 1;
constexpr std::uint32_t kContradictions = 2;
constexpr std::uint32_t kPositionUnknown = 3;
constexpr std::uint32_t kSyncMissing = 4;

class StreamTest : public DrivesTest {
 protected:
  void make_synchronous() {
    bench.run_for(600'000);
    bench.set_transmission(0x1400);
  }
  // The newest emergency in the history: code, and two bytes of information above it.
  std::uint32_t newest_error() { return bench.read(0x1003, 1); }
  void expect_withheld(std::uint32_t why) { EXPECT_EQ(newest_error(), why << 16 | kSetsWithheld); }
  // Number of evaluated sets that were neither sent nor undone.
  std::uint32_t waiting() {
    return bench.compensator().counters().cycles - bench.node().joint_counters().steps;
  }
  const JointCounters& counters() { return bench.node().joint_counters(); }
};

class InlineStreamTest : public StreamTest {};
class OffsetStreamTest : public StreamTest {};

TEST_P(InlineStreamTest, SetsWithMissingFrames_RaiseEmergency) {
  // The alarm does not depend on how many sets went out before.
  for (int before = 10; before < 12; ++before) {
    rest(kStand, before);
    for (int k = 0; k < 110; ++k) {
      bench.now_us += 1000;
      bench.from_controller(NodeBench::targets(kStand)[0]);
    }
    expect_withheld(kFramesMissing);
    rest(kStand, 10);
    EXPECT_EQ(bench.read(0x1001, 0), 0U);
    ASSERT_EQ(bench.write(0x1003, 0, 0, 1), 0U);
  }
}

TEST_P(InlineStreamTest, ContradictedSets_RaiseEmergency) {
  for (const bool is_synchronous : {false, true}) {
    if (is_synchronous) make_synchronous();
    rest(kStand, 10);
    ASSERT_EQ(bench.write(0x1003, 0, 0, 1), 0U);
    const std::uint32_t before = counters().conflicts;
    for (int k = 0; k < 110; ++k) {
      bench.next_sync();
      bench.command_joints(kStand);
      bench.from_controller(NodeBench::targets(moved(kStand, 5))[0]);
    }
    EXPECT_EQ(counters().conflicts, before + 110);
    expect_withheld(kContradictions);
    bench.sync();
    EXPECT_EQ(waiting(), 0U) << "what was evaluated is taken back";
  }
}

TEST_P(InlineStreamTest, SynchronousTargetsWithoutSync_RaiseEmergency) {
  make_synchronous();
  ASSERT_EQ(bench.write(0x1003, 0, 0, 1), 0U);
  for (int k = 0; k < 110; ++k) {
    bench.now_us += 1000;
    bench.command_joints(kStand);
  }
  expect_withheld(kSyncMissing);
}

TEST_P(OffsetStreamTest, ArmAlwaysInMotion_ReportsUnknownPosition) {
  for (int k = 0; k < 130; ++k) cycle(moved(kStand, 100 * k));
  expect_withheld(kPositionUnknown);
}

TEST_P(InlineStreamTest, SyncStops_TheSetWindowTakesOver) {
  settle();
  const std::uint32_t sets = counters().sets;
  for (int k = 0; k < 100; ++k) {
    bench.now_us += 1000;
    bench.command_joints(moved(kStand, k));
  }
  EXPECT_GT(counters().sets, sets + 70) << "20 ms of it: SYNC could still be late";
}

TEST_P(StreamTest, AsynchronousTargetsSlowerThanSync_GoOut) {
  settle();
  for (const int every : {2, 3}) {
    const std::uint32_t before = counters().sets;
    for (int k = 0; k < 10 * every; ++k) {
      bench.next_sync();
      if (k % every == 0) bench.command_joints(kStand);
    }
    EXPECT_GE(counters().sets, before + 9) << "all but the first at this rate";
  }
}

TEST_P(InlineStreamTest, PdoReconfiguration_UndoesTheSetThatWaitsForSync) {
  make_synchronous();
  ASSERT_EQ(bench.write(0x2000, 3, 1'000'000, 4), 0U);
  ASSERT_EQ(bench.write(0x2000, 5, 100, 4), 0U);
  for (int k = 0; k < 20; ++k) cycle(kStand);
  EXPECT_EQ(waiting(), 1U);
  bench.run_for(150'000);
  EXPECT_EQ(waiting(), 1U) << "SYNC may still come";
  ASSERT_EQ(bench.write(0x1412, 2, 1, 1), 0U);
  EXPECT_EQ(waiting(), 0U);
}

TEST_P(StreamTest, EveryEvaluatedSet_IsSentOrUndone) {
  settle();
  EXPECT_EQ(waiting(), 0U);
  make_synchronous();
  for (int k = 0; k < 20; ++k) cycle(kStand);
  bench.sync();
  EXPECT_EQ(waiting(), 0U);
  cycle(kStand);
  bench.nmt(128);
  bench.run_for(1'000'000);
  EXPECT_EQ(waiting(), 0U);
}

TEST_P(InlineStreamTest, ShortActualPositions_AreCounted) {
  settle();
  bench.from_drives(make_frame(0x1C0, {1, 2, 3}));
  EXPECT_EQ(counters().malformed, 1U);
  EXPECT_EQ(bench.read(0x2001, 10), 1U);
}

TEST_P(InlineStreamTest, ShortActualPositions_AreReportedAndNotPassedOn) {
  constexpr std::uint32_t kPdoLength = 0x8210;
  settle();
  bench.upstream.take_sent();
  // The position of joint 1 is whole and contains its correction; that of joint 2 is not.
  CanFrame frame = NodeBench::pair_frame(0x1C0, stand[0], stand[1]);
  frame.len = 7;
  bench.from_drives(frame);
  EXPECT_TRUE(bench.sent(0x1C0).empty());
  EXPECT_EQ(bench.read(0x1003, 1), 0x1C0U << 16 | kPdoLength);
  bench.from_drives(make_frame(0x1C1, {1, 2, 3}));
  for (int k = 0; k < 200; ++k) {
    bench.next_sync();
    bench.command_joints(target);
  }
  EXPECT_EQ(bench.read(0x1003, 0), 1U) << "clean sets of targets do not end it";
  EXPECT_EQ(bench.read(0x1001, 0), 0x11U);
  frame.len = 8;
  bench.from_drives(frame);
  EXPECT_EQ(bench.read(0x1001, 0), 0x11U) << "the other pair";
  bench.from_drives(NodeBench::pair_frame(0x1C1, stand[2], stand[3]));
  EXPECT_EQ(bench.read(0x1001, 0), 0U);
}

TEST_P(InlineStreamTest, ActualPositionOfASeventhAxis_IsIgnored) {
  ASSERT_EQ(bench.write(0x160C, 0, 0, 1), 0U);
  ASSERT_EQ(bench.write(0x160C, 1, 0x90640020, 4), 0U);
  ASSERT_EQ(bench.write(0x160C, 0, 1, 1), 0U);
  ASSERT_EQ(bench.write(0x140C, 1, 0x1F0, 4), 0U);
  for (int k = 0; k < 20; ++k) {
    bench.from_drives(make_frame(0x1F0, {1, 2, 3, 4}));
    cycle(kStand);
  }
  EXPECT_EQ(status() & kUnknownBit, 0U) << "the six joints were heard";
}

TEST_P(InlineStreamTest, JointWithoutActualPosition_KeepsTheUnknownBit) {
  ASSERT_EQ(bench.write(0x1408, 1, 0x800001C0, 4), 0U);
  ASSERT_EQ(bench.write(0x1608, 0, 0, 1), 0U);
  ASSERT_EQ(bench.write(0x1608, 1, 0x68640020, 4), 0U);  // joint 2 alone
  ASSERT_EQ(bench.write(0x1608, 0, 1, 1), 0U);
  ASSERT_EQ(bench.write(0x1408, 1, 0x1C0, 4), 0U);
  rest(kStand, 20);
  EXPECT_EQ(status() & kUnknownBit, kUnknownBit) << "joint 1";
}

TEST_P(OffsetStreamTest, OffsetsReadBackFromDrives_MayBeAFewCyclesOld) {
  map_offset_of_joint_1();
  settle();
  // The joints move, so that the offset differs in every cycle.
  std::vector<std::int32_t> had(1, held[0]);
  for (int k = 1; k < 60; ++k) {
    cycle(moved(kStand, 2000 * k));
    had.push_back(held[0]);
    const std::size_t age = static_cast<std::size_t>(k < 30 ? 0 : 3);
    drive_has(had[had.size() - 1 - age]);
  }
  EXPECT_NE(had[20], had[50]);
  EXPECT_EQ(bench.read(0x1001, 0), 0U);
  // Twenty values in a row that are none of those raise the alarm; nineteen do not.
  for (int k = 0; k < 19; ++k) drive_has(1'000'000);
  EXPECT_EQ(bench.read(0x1001, 0), 0U);
  drive_has(held[0]);
  for (int k = 0; k < 19; ++k) drive_has(1'000'000);
  EXPECT_EQ(bench.read(0x1001, 0), 0U);
  drive_has(1'000'000);
  EXPECT_EQ(newest_error(), 0x0001FF17U);
}

// The mode decides where offsets go, not the number of buses.
TEST(OffsetModeOnTwoBuses, Targets_PassUnchangedAndOffsetsLeaveToTheController) {
  NodeBench bench;
  bench.install(TestTable{}.image());
  bench.configure(Mode::kOffset);
  for (int k = 0; k < 50; ++k) {
    bench.now_us += 1000;
    bench.upstream.take_sent();
    bench.downstream.take_sent();
    bench.command_joints(kStand);
  }
  const std::vector<CanFrame> passed = bench.downstream.take_sent();
  ASSERT_EQ(passed.size(), 3U);
  for (std::size_t k = 0; k < 3; ++k) {
    EXPECT_TRUE(std::equal(passed[k].data, passed[k].data + 8, NodeBench::targets(kStand)[k].data));
  }
  const std::vector<CanFrame> offsets = bench.upstream.take_sent();
  ASSERT_EQ(offsets.size(), 3U);
  EXPECT_EQ(offsets[0].id, 0x1A0U);
  EXPECT_NE(load_le<std::int32_t>(offsets[0].data), 0);
}

class OffsetOnTwoBusesTest : public testing::Test {
 protected:
  OffsetOnTwoBusesTest() {
    bench.install(TestTable{}.image());
    bench.send_offsets();
  }
  // A cycle of an arm that stands at kStand; how many frames with offsets left.
  std::ptrdiff_t cycle(bool drives_are_downstream) {
    bench.now_us += 1000;
    for (std::uint32_t pair = 0; pair < 3; ++pair) {
      const CanFrame actual =
          NodeBench::pair_frame(0x1C0 + pair, kStand[2 * pair], kStand[2 * pair + 1]);
      drives_are_downstream ? bench.from_drives(actual) : bench.from_controller(actual);
    }
    bench.upstream.take_sent();
    bench.command_joints(kStand);
    const std::vector<CanFrame> sent = bench.upstream.take_sent();
    return std::count_if(sent.begin(), sent.end(), [](const CanFrame& frame) {
      return (frame.id & 0xFFU) == 0xA0U && frame.id > 0xA0U;
    });
  }
  NodeBench bench;
};

TEST_F(OffsetOnTwoBusesTest, DrivesHeardDownstream_OffsetModeIsRefused) {
  bench.configure(Mode::kInline);
  cycle(true);
  bench.run_for(600'000);
  EXPECT_EQ(bench.write(0x2000, 1, 2, 1), 0x06040043U);
}

TEST_F(OffsetOnTwoBusesTest, DrivesHeardDownstreamInOffsetMode_RaiseEmergency) {
  bench.configure(Mode::kOffset);
  for (int k = 0; k < 150; ++k) ASSERT_EQ(cycle(true), 0) << k;
  EXPECT_EQ(bench.read(0x1003, 1), 5U << 16 | kSetsWithheld);
  EXPECT_EQ(bench.read(0x2001, 2) & 1U, 0U) << "not configured";
}

TEST_F(OffsetOnTwoBusesTest, DrivesKnownUpstream_AStrayFrameDownstreamChangesNothing) {
  bench.configure(Mode::kOffset);
  for (int k = 0; k < 150; ++k) cycle(false);
  bench.from_drives(NodeBench::pair_frame(0x1C0, 1, 2));
  EXPECT_EQ(cycle(false), 3);
}

INSTANTIATE_TEST_SUITE_P(Modes, StreamTest, ::testing::Values(Mode::kInline, Mode::kOffset),
                         mode_name);
INSTANTIATE_TEST_SUITE_P(Modes, InlineStreamTest, ::testing::Values(Mode::kInline), mode_name);
INSTANTIATE_TEST_SUITE_P(Modes, OffsetStreamTest, ::testing::Values(Mode::kOffset), mode_name);

}  // namespace
}  // namespace armtrue::canopen
