// Starts, NMT states and resets of a node: what each keeps, ends and begins.
#include <gtest/gtest.h>

#include <cstdlib>
#include <vector>

#include "firmware/testing/node_bench.h"
#include "firmware/testing/test_table.h"

namespace armtrue::canopen {
namespace {

class LifeTest : public testing::Test {
 protected:
  void nmt(int command) { bench.nmt(command); }
  std::uint32_t error_register() { return bench.read(0x1001, 0); }
  std::size_t targets_sent() {
    std::size_t count = 0;
    for (const CanFrame& frame : bench.downstream.take_sent()) {
      count += frame.id == 0x220 || frame.id == 0x320 || frame.id == 0x420;
    }
    return count;
  }
  void cycle() {
    bench.now_us += 1000;
    bench.command_joints({});
  }

  NodeBench bench;
};

TEST_F(LifeTest, SavedHeartbeats_AreWatchedFromTheStartOn) {
  for (std::uint8_t slot = 1; slot <= 8; ++slot) {
    ASSERT_EQ(bench.write(0x1016, slot, (4U + slot) << 16 | 100U, 4), 0U);
  }
  ASSERT_EQ(bench.write(0x1010, 1, kSave, 4), 0U);
  bench.power_on();
  for (int node = 5; node < 13; ++node) {
    bench.from_controller(make_frame(0x700U + static_cast<std::uint32_t>(node), {5}));
  }
  bench.run_for(150'000);
  EXPECT_EQ(bench.read(0x1003, 0), 8U) << "all of them were lost";
}

TEST_F(LifeTest, SavedPositionLimits_HoldFromTheStartOn) {
  ASSERT_EQ(bench.write(0x607D, 2, 1000, 4), 0U);
  ASSERT_EQ(bench.write(0x607D + 5 * 0x800, 2, 6000, 4), 0U);
  EXPECT_EQ(bench.compensator().bounds(0).limit_high, 1000);
  ASSERT_EQ(bench.write(0x1010, 1, kSave, 4), 0U);
  bench.power_on();
  EXPECT_EQ(bench.compensator().bounds(0).limit_high, 1000);
  EXPECT_EQ(bench.compensator().bounds(5).limit_high, 6000);
}

TEST_F(LifeTest, DamagedParameters_AreReportedAfterAResetOfCommunication) {
  ASSERT_EQ(bench.write(0x1010, 1, kSave, 4), 0U);
  bench.parameters.spoil(20);
  nmt(130);
  bench.run_for(1000);
  EXPECT_NE(error_register(), 0U);
}

TEST_F(LifeTest, ATransferContinues_WhenTheNodeIsStarted) {
  bench.ask({0x21, 0x10, 0x20, 0, 9, 0, 0, 0});
  nmt(1);
  EXPECT_EQ(bench.ask({0x00, 1, 2, 3, 4, 5, 6, 7})[0], 0x20);
  EXPECT_EQ(bench.ask({0x10 | 5 << 1 | 1, 8, 9, 0, 0, 0, 0, 0})[0], 0x30);
  EXPECT_EQ(bench.read(0x2013, 3), 9U);
}

TEST_F(LifeTest, ATransferEnds_WhenTheNodeIsStopped) {
  bench.ask({0x21, 0x10, 0x20, 0, 9, 0, 0, 0});
  nmt(2);
  nmt(128);
  EXPECT_EQ(bench.ask({0x00, 1, 2, 3, 4, 5, 6, 7})[0], 0x80);
}

TEST_F(LifeTest, LeavingOperational_DropsThePartialSet) {
  bench.configure(Mode::kInline);
  for (int k = 0; k < 3; ++k) cycle();
  targets_sent();
  bench.now_us += 1000;
  // All of it in one turn of the loop.
  const auto frames = NodeBench::targets({1, 2, 3, 4, 5, 6});
  bench.upstream.deliver(frames[0]);
  bench.upstream.deliver(frames[1]);
  bench.upstream.deliver(make_frame(0, {128, NodeBench::kNodeId}));
  bench.upstream.deliver(make_frame(0, {1, NodeBench::kNodeId}));
  bench.upstream.deliver(frames[2]);
  bench.turn();
  EXPECT_EQ(targets_sent(), 0U);
}

TEST_F(LifeTest, LeavingOperational_DropsASetThatWaitsForSync) {
  bench.set_transmission(0x1400);
  bench.configure(Mode::kInline);
  const auto sync = [this] { bench.upstream.deliver(make_frame(0x80, {})); };
  for (int k = 0; k < 3; ++k) {
    sync();
    cycle();
  }
  const auto frames = NodeBench::targets({1, 2, 3, 4, 5, 6});
  sync();
  bench.upstream.deliver(frames[0]);
  bench.upstream.deliver(frames[1]);
  bench.turn();
  targets_sent();
  bench.upstream.deliver(make_frame(0, {128, NodeBench::kNodeId}));
  bench.upstream.deliver(make_frame(0, {1, NodeBench::kNodeId}));
  bench.upstream.deliver(frames[2]);
  sync();
  bench.turn();
  EXPECT_EQ(targets_sent(), 0U);
}

TEST_F(LifeTest, LeavingOperational_IsNotCountedAsAnInterruption) {
  bench.configure(Mode::kInline);
  for (int k = 0; k < 3; ++k) cycle();
  EXPECT_NE(bench.read(0x2001, 2) & 2U, 0U) << "streaming";
  nmt(128);
  EXPECT_EQ(bench.read(0x2001, 2) & 2U, 0U);
  bench.run_for(50'000);
  EXPECT_EQ(bench.node().joint_counters().stale, 0U) << "it was ended, it did not fail";
  EXPECT_EQ(error_register(), 0U);
}

TEST_F(LifeTest, LeavingOperational_EndsTheErrorOfWithheldSets) {
  bench.configure(Mode::kInline);
  for (int k = 0; k < 3; ++k) cycle();
  const auto frames = NodeBench::targets({});
  for (int k = 0; k < 150; ++k) {
    bench.now_us += 1000;
    bench.from_controller(frames[0]);
  }
  EXPECT_NE(error_register(), 0U);
  nmt(128);
  // The error of the stale stream stays, because the stream was interrupted.
  bench.start_nodes();
  for (int k = 0; k < 3; ++k) cycle();
  EXPECT_EQ(error_register(), 0U);
  for (int k = 0; k < 150; ++k) {
    bench.now_us += 1000;
    bench.from_controller(frames[0]);
  }
  bench.upstream.take_sent();
  nmt(128);
  bench.run_for(10'000);
  int ended = 0;
  for (const CanFrame& frame : bench.upstream.take_sent()) {
    EXPECT_NE(load_le<std::uint16_t>(frame.data), 0xFF15) << "raised anew";
    ended +=
        frame.id == 0x80U + NodeBench::kNodeId && load_le<std::uint16_t>(&frame.data[3]) == 0xFF15;
  }
  EXPECT_EQ(ended, 1);
}

TEST_F(LifeTest, ExtendedFrame_IsNotTakenAsHeartbeat) {
  ASSERT_EQ(bench.write(0x1016, 1, 0x00050064, 4), 0U);
  bench.from_drives(make_frame(0x705, {5}));
  CanFrame extended = make_frame(0x705, {5});
  extended.flags = kFrameExtended;
  for (int k = 0; k < 15; ++k) {
    bench.run_for(10'000);
    bench.from_drives(extended);
  }
  EXPECT_EQ(bench.read(0x1003, 1), 0x00058130U);
}

TEST_F(LifeTest, HeartbeatsFromTheDrivesSide_AreReceived) {
  ASSERT_EQ(bench.write(0x1016, 1, 0x00050064, 4), 0U);
  for (int k = 0; k < 15; ++k) {
    bench.from_drives(make_frame(0x705, {5}));
    bench.run_for(90'000);
  }
  EXPECT_EQ(error_register(), 0U);
  bench.run_for(20'000);
  EXPECT_NE(error_register(), 0U);
}

TEST_F(LifeTest, HeartbeatOfNode1Returns_ClearsItsError) {
  ASSERT_EQ(bench.write(0x1016, 1, 0x00010064, 4), 0U);
  bench.from_controller(make_frame(0x701, {5}));
  bench.run_for(150'000);
  EXPECT_NE(error_register(), 0U);
  bench.from_controller(make_frame(0x701, {5}));
  EXPECT_EQ(error_register(), 0U);
}

TEST_F(LifeTest, ResetCommunication_KeepsTheResolutionOfTheTable) {
  ASSERT_EQ(bench.write(0x1010, 1, kSave, 4), 0U);
  bench.install(TestTable{}.image());
  ASSERT_EQ(bench.read(0x608F, 1), 1U << 20);
  nmt(130);
  bench.run_for(1000);
  EXPECT_EQ(bench.read(0x608F, 1), 1U << 20);
}

// Offset mode: an NMT command waits while the offsets fade.
class OffsetLifeTest : public testing::Test {
 protected:
  void start(std::uint32_t transmission) {
    bench.install(TestTable{}.image());
    bench.set_transmission(0x1400, transmission);
    bench.configure(Mode::kOffset);
    for (int k = 0; k < 50; ++k) {
      bench.next_sync();
      command();
    }
  }
  void command() { bench.command_joints({250'000, 300'000, 150'000, -250'000, 270'000, -200'000}); }
  // Offsets of joint 1 that have left since the last call.
  std::vector<std::int32_t> offsets() {
    std::vector<std::int32_t> found;
    for (const CanFrame& frame : bench.upstream.take_sent()) {
      if (frame.id == 0x1A0) found.push_back(load_le<std::int32_t>(frame.data));
    }
    return found;
  }
  NodeBench bench{false};
};

TEST_F(OffsetLifeTest, FadeAtNmtStop_UndoesTheSetThatWaitsForSync) {
  start(1);
  std::int32_t last = offsets().back();
  ASSERT_GT(std::abs(last), 150);
  const auto evaluated = [this] { return bench.compensator().counters().cycles; };
  const auto put_out = [this] { return bench.node().joint_counters().steps; };
  EXPECT_EQ(evaluated(), put_out() + 1U) << "one waits for its SYNC";
  bench.nmt(2);
  bench.run_for(500'000);
  EXPECT_EQ(bench.node().nmt_state(), NmtState::kStopped);
  EXPECT_EQ(evaluated(), put_out()) << "nobody got it";
  for (const std::int32_t offset : offsets()) {
    EXPECT_LE(std::abs(offset - last), 106) << "0.1 turn a second";
    last = offset;
  }
  EXPECT_EQ(last, 0);
}

TEST_F(OffsetLifeTest, BackToBackSets_DoNotSlowDownTheFade) {
  start(255);
  bench.run_for(30'000);  // SYNC is not in use any more
  for (int k = 0; k < 20; ++k) {
    bench.now_us += 70;
    command();
  }
  bench.nmt(2);
  bench.run_for(5000);
  EXPECT_EQ(bench.node().nmt_state(), NmtState::kStopped) << "170 increments by 105 a millisecond";
}

// A start replaces the stop that waits for the fade, but the offsets still go to zero first.
TEST_F(OffsetLifeTest, StartDuringTheFade_FirstSetContinuesFromZero) {
  start(255);
  bench.run_for(30'000);
  std::int32_t held = offsets().back();
  ASSERT_GT(std::abs(held), 150);
  bench.nmt(128);
  bench.nmt(1);
  bool has_ended = false;
  for (int k = 0; k < 60; ++k) {
    bench.now_us += 500;
    bench.turn();
    bench.now_us += 500;
    command();
    for (const std::int32_t offset : offsets()) {
      EXPECT_LE(std::abs(offset - held), has_ended ? 10 : 106) << k;
      held = offset;
      has_ended = has_ended || offset == 0;
    }
  }
  EXPECT_TRUE(has_ended);
  EXPECT_GT(std::abs(held), 150);
  EXPECT_EQ(bench.node().nmt_state(), NmtState::kOperational);
}

}  // namespace
}  // namespace armtrue::canopen
