// Offsets that the drives hold in offset mode: start of the compensator at an arm that rests or
// moves, and the fade of the offsets to zero.
#include "firmware/testing/drives_bench.h"

namespace armtrue::canopen {
namespace {

// In offset mode the drives follow the controller directly and keep their last offset.
class OffsetDrivesTest : public DrivesTest {
 protected:
  // Two turns of the main loop per millisecond: a turn without a new cycle permits no step.
  OffsetDrivesTest() { turn_us = 500; }
  static constexpr std::int32_t kRate = 105;  // 0.1 turn per second, increments in a cycle
};

TEST_P(OffsetDrivesTest, StartInMotion_SendsNoOffsetsUntilTheArmRests) {
  settle();
  restart();
  following_error = 70;
  const Joints before = held;
  for (int k = 0; k < 300; ++k) {
    cycle(moved(kStand, 30 * k));
    ASSERT_EQ(outputs, 0) << k;
  }
  EXPECT_EQ(held, before);
  EXPECT_EQ(status() & kUnknownBit, kUnknownBit);
  const Joints there = moved(kStand, 30 * 299);
  following_error = 0;
  EXPECT_EQ(rest(there, 95), 0);
  EXPECT_LE(rest(there, 100), kBlendStep);
  EXPECT_EQ(seen, there);
  EXPECT_EQ(status() & kUnknownBit, 0U);
}

// Drives report their position every 500 ms. The last report before standstill was sent in motion.
TEST_P(OffsetDrivesTest, PositionReceivedInMotion_IsNotUsedAfterStopping) {
  settle();
  restart();
  Joints there = kStand;
  const auto move_on = [&](int cycles, std::int32_t step) {
    std::int32_t most = 0;
    for (int k = 0; k < cycles; ++k) {
      const Joints before = held;
      there[0] += step;
      target = there;
      bench.next_sync();
      bench.command_joints(there);
      take_output();
      most = std::max(most, farthest(before, held));
    }
    return most;
  };
  const Joints before = held;
  feed_back();
  move_on(40, 6);
  EXPECT_EQ(move_on(450, 0), 0);
  EXPECT_EQ(held, before) << "no position has been heard since the stand";
  EXPECT_EQ(bench.read(0x1003, 1), kPositionUnknown << 16 | kSetsWithheld);
  take_output();
  feed_back();
  EXPECT_LE(move_on(300, 0), kBlendStep);
  EXPECT_EQ(status() & kUnknownBit, 0U);
  EXPECT_EQ(bench.read(0x1001, 0), 0U);
}

// Targets and positions received while no set was evaluated do not show that the arm stands still.
TEST_P(OffsetDrivesTest, StandstillBeforePreOperational_DoesNotCount) {
  settle();
  restart();
  rest(kStand, 90);
  nmt(128);
  for (int k = 0; k < 20; ++k) cycle(moved(kStand, k < 19 ? 30 * k : 0));
  bench.start_nodes();
  outputs = 0;
  for (int k = 0; k < 95; ++k) {
    cycle(kStand);
    ASSERT_EQ(outputs, 0) << k;
  }
}

TEST_P(OffsetDrivesTest, ActualPositionsReceivedBeforeNodeStart_AreUsed) {
  settle();
  bench.power_on();
  take_output();
  feed_back();
  bench.start_nodes();
  for (int k = 0; k < 50; ++k) {
    bench.next_sync();
    bench.command_joints(kStand);
    take_output();
    ASSERT_EQ(outputs, 0) << "until the arm has stood for 0.1 s";
  }
}

TEST_P(OffsetDrivesTest, DifferenceBeyondPermitted_SendsNoOffsets) {
  settle();
  restart();
  following_error = 1000;
  rest(kStand, 300);
  EXPECT_EQ(status() & kUnknownBit, kUnknownBit);
  EXPECT_GT(farthest(held, {}), 150) << "what it held before";
}

TEST_P(OffsetDrivesTest, RefusedStart_LeavesNoCorrection) {
  settle();
  restart();
  following_error = 1000;
  rest(kStand, 300);
  wait(1'100);
  EXPECT_EQ(bench.read(0x2001, 1), 0U);
  EXPECT_EQ(bench.write(0x607D, 2, 50'000'000, 4), 0U) << "at rest, without a correction";
}

TEST_P(OffsetDrivesTest, FirstSetNotSent_LeavesNoCorrection) {
  settle();
  wait(1'100);
  bench.set_transmission(0x1400);
  ASSERT_EQ(bench.write(0x1010, 1, kSave, 4), 0U);
  restart();
  bench.now_us += 1000;
  feed_back();
  for (int k = 0; k < 150; ++k) {
    bench.now_us += 1000;
    bench.command_joints(kStand);
  }
  wait(600);
  EXPECT_EQ(status() & kUnknownBit, kUnknownBit) << "no SYNC came";
  EXPECT_EQ(bench.read(0x2001, 1), 0U);
}

TEST_P(OffsetDrivesTest, NmtStop_FadesOffsetsToZeroFirst) {
  for (const int command : {2, 128}) {
    for (const bool synchronous : {false, true}) {
      SCOPED_TRACE(command * 10 + synchronous);
      settle();
      if (synchronous) {
        wait(600);
        bench.set_transmission(0x1800);
        rest(kStand, 5);
      }
      ASSERT_EQ(bench.write(0x1017, 0, 1, 2), 0U);
      nmt(command);
      EXPECT_EQ(state(), NmtState::kOperational) << "until the offsets are zero";
      EXPECT_LE(wait(100), kRate);
      EXPECT_EQ(held, Joints{});
      EXPECT_EQ(state(), command == 2 ? NmtState::kStopped : NmtState::kPreOperational);
      EXPECT_EQ(seen, kStand);
      bench.start_nodes();
      ASSERT_EQ(bench.write(0x1017, 0, 0, 2), 0U);
      wait(600);
    }
  }
}

// A fade takes 2000 control periods, here 8 s.
TEST_P(OffsetDrivesTest, NmtStop_WithALongControlPeriod_WaitsForTheWholeFade) {
  bench.cycle_us = 4000;
  restart();
  settle();
  wait(1'100);
  bench.install(TestTable{.sequence = 2, .magnitude = kPermitted << 12, .rate = kMinRate}.image());
  rest(kStand, 10);
  ASSERT_GT(farthest(held, {}), 150);
  nmt(2);
  wait(6'000);
  EXPECT_EQ(state(), NmtState::kOperational);
  wait(3'000);
  EXPECT_EQ(state(), NmtState::kStopped);
  EXPECT_EQ(held, Joints{});
}

TEST_P(OffsetDrivesTest, NmtStopInMotion_FadesOffsetsToZeroFirst) {
  settle();
  nmt(2);
  for (int k = 0; k < 100; ++k) {
    const Joints before = held;
    cycle(moved(kStand, 30 * k));
    EXPECT_LE(farthest(before, held), kRate);
  }
  EXPECT_EQ(held, Joints{});
  EXPECT_EQ(state(), NmtState::kStopped);
}

TEST_P(OffsetDrivesTest, NmtStartDuringTheFade_ReplacesTheStop) {
  settle();
  nmt(2);
  wait(1);
  nmt(1);
  EXPECT_LE(rest(kStand, 300), kRate);
  EXPECT_EQ(state(), NmtState::kOperational);
  EXPECT_GT(farthest(held, {}), 150);
}

TEST_P(OffsetDrivesTest, NmtForOtherNodesOrUnknown_KeepsOffsets) {
  settle();
  const Joints before = held;
  bench.nmt(2, NodeBench::kNodeId + 1);
  for (const int unknown : {0x4D, 0x90, 0xFF}) nmt(unknown);
  wait(50);
  EXPECT_EQ(held, before);
  EXPECT_EQ(state(), NmtState::kOperational);
}

TEST_P(OffsetDrivesTest, Resets_FadeOffsetsToZeroFirst) {
  for (const int command : {129, 130}) {
    settle();
    nmt(command);
    EXPECT_LE(wait(100), kRate);
    EXPECT_EQ(held, Joints{});
    EXPECT_EQ(state(), NmtState::kPreOperational);
    bench.start_nodes();
  }
}

TEST_P(OffsetDrivesTest, Reset_DiscardsQueuedTargets) {
  for (const int command : {129, 130}) {
    settle();
    nmt(command);
    for (int k = 0; k < 10; ++k) {
      bench.now_us += 1000;
      bench.upstream.deliver(make_frame(0x80, {}));
      for (const CanFrame& frame : NodeBench::targets(kStand)) bench.upstream.deliver(frame);
      bench.turn();
    }
    take_output();
    ASSERT_EQ(held, Joints{});
    bench.start_nodes();
    bench.now_us += 1000;
    target = stand = kStand;
    EXPECT_LE(rest(kStand, 200), kBlendStep);
    EXPECT_EQ(status() & kUnknownBit, 0U) << "begun with what was heard in the new life";
  }
}

TEST_P(OffsetDrivesTest, LostHeartbeat_FadesOffsetsToZeroFirst) {
  ASSERT_EQ(bench.write(0x1016, 1, 0x00050064, 4), 0U);
  settle();
  bench.from_controller(make_frame(0x705, {5}));
  EXPECT_LE(wait(300), kRate);
  EXPECT_EQ(held, Joints{});
  EXPECT_EQ(state(), NmtState::kPreOperational);
}

TEST_P(OffsetDrivesTest, ChangeOfMode_FadesOffsetsToZeroFirst) {
  settle();
  wait(600);
  ASSERT_GT(farthest(held, {}), 150) << "stale targets alone move nothing";
  ASSERT_EQ(bench.write(0x2000, 1, 0, 1), 0U);
  EXPECT_LE(wait(100), kRate);
  EXPECT_EQ(held, Joints{});
  wait(600);
  target = moved(kStand, 700);
  bench.command_joints(target);
  take_output();
  EXPECT_EQ(outputs, 0) << "forward";
}

TEST_P(OffsetDrivesTest, ChangeOfModeRevertedAtOnce_RestoresOffsets) {
  settle();
  wait(600);
  ASSERT_EQ(bench.write(0x2000, 1, 0, 1), 0U);
  ASSERT_EQ(bench.write(0x2000, 1, 2, 1), 0U);
  take_output();
  EXPECT_LE(rest(kStand, 300), kRate);
  EXPECT_GT(farthest(held, {}), 150);
}

TEST_P(OffsetDrivesTest, DisablingAtRest_ZeroesOffsets_EnablingRestoresThem) {
  settle();
  wait(600);
  const Joints before = held;
  ASSERT_EQ(bench.write(0x2000, 2, 0, 1), 0U);
  EXPECT_LE(wait(100), kBlendStep);
  EXPECT_EQ(held, Joints{});
  EXPECT_EQ(seen, kStand);
  wait(600);
  ASSERT_EQ(bench.write(0x2000, 2, 1, 1), 0U);
  EXPECT_EQ(wait(100), 0) << "nothing goes out by itself but the way to zero";
  EXPECT_LE(rest(kStand, 100), kBlendStep);
  EXPECT_EQ(held, before);
}

TEST_P(OffsetDrivesTest, DisabledInPreOperational_StaysDisabledAfterStart) {
  settle();
  nmt(128);
  wait(100);
  ASSERT_EQ(state(), NmtState::kPreOperational);
  ASSERT_EQ(bench.write(0x2000, 2, 0, 1), 0U);
  bench.start_nodes();
  rest(kStand, 200);
  EXPECT_EQ(held, Joints{});
}

TEST_P(OffsetDrivesTest, DisablingInMotion_FadesOffsetsToZero) {
  settle();
  ASSERT_EQ(bench.write(0x2000, 2, 0, 1), 0U);
  for (int k = 0; k < 60; ++k) {
    const Joints before = held;
    cycle(moved(kStand, 30 * k));
    EXPECT_EQ(outputs, 3) << "one set of offsets for each of targets";
    EXPECT_LE(farthest(before, held), kBlendStep);
  }
  EXPECT_EQ(held, Joints{});
}

TEST_P(OffsetDrivesTest, SynchronousOffsets_LeaveWithSyncOncePerSet) {
  bench.set_transmission(0x1800);
  settle();
  for (int k = 0; k < 20; ++k) {
    bench.now_us += 1000;
    bench.command_joints(moved(kStand, 100 * k));
    take_output();
    ASSERT_EQ(outputs, 0) << "not at once";
    bench.sync();
    take_output();
    ASSERT_EQ(outputs, 3) << k;
  }
  for (int k = 0; k < 10; ++k) {
    bench.next_sync();
    take_output();
    ASSERT_EQ(outputs, 0) << "no new set, no old offset";
  }
}

TEST_P(OffsetDrivesTest, OffsetsRefusedByTheBus_AreCounted) {
  for (const bool synchronous : {false, true}) {
    if (synchronous) {
      bench.run_for(600'000);
      bench.set_transmission(0x1800);
    }
    settle();
    const std::uint32_t before = bench.read(0x2001, 14);
    bench.upstream.take_sent();
    bench.upstream.set_room(1);
    bench.next_sync();
    bench.command_joints(kStand);
    bench.sync();
    bench.upstream.set_room(SIZE_MAX);
    bench.upstream.take_sent();
    // One frame of three finds room; those that wait for SYNC are refused at the next one, too.
    EXPECT_EQ(bench.read(0x2001, 14), before + (synchronous ? 5 : 2));
  }
}

INSTANTIATE_TEST_SUITE_P(Offset, OffsetDrivesTest, ::testing::Values(Mode::kOffset));

}  // namespace
}  // namespace armtrue::canopen
