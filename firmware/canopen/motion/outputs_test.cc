// Outputs that do not reach the drives: the bus refuses them, SYNC is absent or releases only every
// n-th set. A step starts from the value that each drive holds; a pause permits no larger step.
#include "firmware/testing/drives_bench.h"

namespace armtrue::canopen {
namespace {

constexpr std::uint32_t kOutputRefused = 7;

// A correction of 0.04 turn, which takes hundreds of cycles at the permitted rate.
class OutputsTest : public DrivesTest {
 protected:
  OutputsTest() {
    bench.run_for(600'000);
    bench.install(TestTable{.sequence = 2, .amplitude = 1 << 30}.image());
    take_output();
  }
  void settle_far() {
    target = stand = kStand;
    rest(kStand, 1200);
    ASSERT_GT(farthest(stand, kStand), 40'000);
    ASSERT_EQ(seen, kStand);
  }
  void make_synchronous(std::uint32_t type) { bench.set_transmission(0x1800, type); }
  std::int32_t sync() {
    const Joints before = stand;
    bench.next_sync();
    take_output();
    return farthest(before, stand);
  }
};
class InlineOutputsTest : public OutputsTest {};
class OffsetOutputsTest : public OutputsTest {};

TEST_P(OffsetOutputsTest, FadeWithoutSync_WaitsForSyncWithoutAStep) {
  make_synchronous(1);
  settle_far();
  const Joints before = held;
  wait(700);
  ASSERT_EQ(bench.write(0x2000, 2, 0, 1), 0U);
  EXPECT_EQ(wait(3000), 0);
  EXPECT_EQ(held, before);
  std::int32_t most = 0;
  for (int k = 0; k < 600; ++k) most = std::max(most, sync());
  EXPECT_LE(most, kRate);
  EXPECT_EQ(held, Joints{});
}

TEST_P(OffsetOutputsTest, NmtStopAfterFadeWithoutSync_ZeroesOffsetsFirst) {
  make_synchronous(1);
  settle_far();
  wait(700);
  ASSERT_EQ(bench.write(0x2000, 2, 0, 1), 0U);
  wait(3000);
  nmt(128);
  EXPECT_EQ(state(), NmtState::kOperational) << "until the offsets are zero";
  EXPECT_LE(wait(600), kRate);
  EXPECT_EQ(held, Joints{});
  EXPECT_EQ(state(), NmtState::kPreOperational);
}

TEST_P(OffsetOutputsTest, BusRefusesOffsets_IsReportedAndCorrectionWaits) {
  for (const std::size_t room : {0U, 1U}) {
    SCOPED_TRACE(room);
    settle_far();
    const std::uint32_t sets = bench.node().joint_counters().sets;
    Joints there = kStand;
    for (int k = 0; k < 300; ++k) {
      bench.next_sync();
      there = moved(there, -150);
      target = there;
      bench.upstream.set_room(room);
      bench.command_joints(there);
      take_output();
      bench.upstream.set_room(SIZE_MAX);
    }
    EXPECT_EQ(bench.node().joint_counters().sets, sets);
    EXPECT_EQ(bench.read(0x1003, 1), kOutputRefused << 16 | kSetsWithheld);
    take_output();
    for (int k = 0; k < 20; ++k) {
      const Joints had = held;
      cycle(there);
      EXPECT_LE(farthest(had, held), kRate);
    }
    EXPECT_EQ(bench.read(0x1001, 0), 0U) << "over with the next that goes out";
    ASSERT_EQ(bench.write(0x1003, 0, 0, 1), 0U);
  }
}

TEST_P(OffsetOutputsTest, BusRefusesSynchronousOffsets_MakesNoStep) {
  make_synchronous(1);
  settle_far();
  Joints there = kStand;
  for (int k = 0; k < 300; ++k) {
    there = moved(there, -150);
    bench.upstream.set_room(0);
    bench.next_sync();
    bench.command_joints(there);
    bench.upstream.set_room(SIZE_MAX);
  }
  EXPECT_EQ(bench.read(0x1003, 1), kOutputRefused << 16 | kSetsWithheld);
  target = there;
  take_output();
  for (int k = 0; k < 20; ++k) {
    const Joints had = held;
    cycle(there);
    EXPECT_LE(farthest(had, held), kRate);
  }
  EXPECT_EQ(bench.read(0x1001, 0), 0U);
}

TEST_P(OffsetOutputsTest, NmtStopWhileTheBusRefuses_WaitsUntilZeroIsSent) {
  settle_far();
  bench.upstream.set_room(0);
  nmt(128);
  wait(2000);
  EXPECT_EQ(state(), NmtState::kOperational);
  bench.upstream.set_room(SIZE_MAX);
  EXPECT_LE(wait(600), kRate);
  EXPECT_EQ(held, Joints{});
  EXPECT_EQ(state(), NmtState::kPreOperational);
}

TEST_P(OffsetOutputsTest, RefusedLastZero_IsSentAgain) {
  settle_far();
  nmt(128);
  for (int k = 0; k < 1000 && state() == NmtState::kOperational; ++k) {
    bench.upstream.set_room(k % 3 == 0 ? 2 : 0);
    wait(1);
  }
  bench.upstream.set_room(SIZE_MAX);
  wait(1000);
  EXPECT_EQ(held, Joints{});
  EXPECT_EQ(state(), NmtState::kPreOperational);
}

TEST_P(OffsetOutputsTest, OffsetsAtEveryNthSync_CarryTheStepOfOneCycle) {
  for (const int type : {2, 10, 100}) {
    SCOPED_TRACE(type);
    bench.run_for(600'000);
    make_synchronous(static_cast<std::uint32_t>(type));
    take_output();
    target = stand = kStand;
    held = {};
    const Joints zero = held;
    for (int k = 0; k < 130 + 30 * type; ++k) {
      const Joints before = held;
      cycle(kStand);
      ASSERT_LE(farthest(before, held), kRate);
      if (held != zero) {
        ASSERT_EQ(seen, kStand) << "without what has not left";
      }
    }
    EXPECT_GT(farthest(held, {}), 20 * kRate) << "and each carries one";
    EXPECT_EQ(bench.read(0x1001, 0), 0U) << "a set that waits is no set that is withheld";
    nmt(128);
    wait(600);
    ASSERT_EQ(state(), NmtState::kPreOperational);
    EXPECT_EQ(held, Joints{});
    bench.start_nodes();
  }
}

TEST_P(OffsetOutputsTest, UnsentOffset_IsNotReportedIn60B0) {
  settle_far();
  ASSERT_EQ(bench.write(0x2000, 2, 0, 1), 0U);
  take_output();
  const Joints before = held;
  bench.now_us += 1000;
  bench.upstream.set_room(0);
  bench.command_joints(kStand);
  bench.upstream.set_room(SIZE_MAX);
  EXPECT_EQ(static_cast<std::int32_t>(bench.read(0x60B0, 0)), before[0]);
  EXPECT_NE(before[0], 0);
}

TEST_P(InlineOutputsTest, SetSentInPart_DoesNotAdvanceTheRefusedJoints) {
  ASSERT_EQ(bench.write(0x2000, 2, 0, 1), 0U);
  target = stand = kStand;
  rest(kStand, 100);
  bench.run_for(600'000);
  ASSERT_EQ(bench.write(0x2000, 2, 1, 1), 0U);
  take_output();
  rest(kStand, 20);
  const Joints before = stand;
  for (int k = 0; k < 300; ++k) {
    bench.next_sync();
    take_output();
    feed_back();
    EXPECT_EQ(seen[5], kStand[5]) << "what is taken off is what it was given";
    bench.downstream.set_room(1);
    bench.command_joints(kStand);
    take_output();
    bench.downstream.set_room(SIZE_MAX);
  }
  ASSERT_GT(std::abs(stand[0] - before[0]), 250 * 100);
  ASSERT_EQ(stand[5], before[5]);
  EXPECT_EQ(static_cast<std::int32_t>(bench.read(0x60B0 + 5 * 0x800, 0)), before[5] - kStand[5]);
  EXPECT_LE(rest(kStand, 1000), kRate);
  EXPECT_GT(std::abs(stand[5] - kStand[5]), 30'000);
}

TEST_P(InlineOutputsTest, RefusedLastStepToZero_IsMadeWithTheNextSet) {
  settle_far();
  ASSERT_EQ(bench.write(0x2000, 2, 0, 1), 0U);
  for (int k = 0; k < 1000; ++k) {
    bench.downstream.set_room(1);
    bench.now_us += 1000;
    bench.command_joints(kStand);
    take_output();
  }
  bench.downstream.set_room(SIZE_MAX);
  ASSERT_EQ(stand[0], kStand[0]);
  ASSERT_NE(stand[5], kStand[5]);
  EXPECT_NE(bench.compensator().state(), CompensatorState::kPassThrough);
  EXPECT_LE(rest(kStand, 1000), kRate);
  EXPECT_EQ(stand, kStand);
  EXPECT_EQ(bench.compensator().state(), CompensatorState::kPassThrough);
}

// The controller accepts frames but can send none for longer than BusWatch::kCommandLifeUs.
TEST_P(OutputsTest, BusTakesNoFrames_ContinuesFromTheValuesInTheDrives) {
  ASSERT_EQ(bench.write(0x2000, 2, 0, 1), 0U);
  target = stand = kStand;
  rest(kStand, 100);
  bench.run_for(600'000);
  ASSERT_EQ(bench.write(0x2000, 2, 1, 1), 0U);
  take_output();
  rest(kStand, 20);
  SimulatedPort& port = offset_ ? bench.upstream : bench.downstream;
  for (const int outage_ms : {25, 33, 47, 300}) {
    SCOPED_TRACE(outage_ms);
    const Joints before = stand;
    port.set_acknowledged(false);
    for (int k = 0; k < outage_ms; ++k) {
      bench.next_sync();
      bench.command_joints(kStand);
    }
    port.set_acknowledged(true);
    take_output();
    EXPECT_LE(farthest(before, stand), offset_ ? 20 * kRate : kRate) << "inline, one set at most";
    EXPECT_LE(rest(kStand, 10), kRate);
    EXPECT_EQ(seen, kStand);
    EXPECT_EQ(bench.read(0x1001, 0), 0U) << "the stream goes on";
  }
  EXPECT_LE(rest(kStand, 1000), kRate);
  EXPECT_GT(farthest(stand, kStand), 30'000);
}

// In short cycles more sets would be queued than the compensator stores corrections for.
TEST_P(OutputsTest, BusTakesNoFramesInShortCycles_ContinuesFromTheValuesInTheDrives) {
  for (const std::uint32_t cycle_us : {500U, 250U, 100U}) {
    SCOPED_TRACE(cycle_us);
    bench.cycle_us = cycle_us;
    restart();
    target = kStand;
    const auto run = [&](std::uint32_t duration_us) {
      std::int32_t most = 0;
      for (std::uint32_t at_us = 0; at_us < duration_us; at_us += cycle_us) {
        const Joints before = stand;
        bench.now_us += cycle_us;
        bench.turn();
        bench.sync();
        bench.command_joints(kStand);
        take_output();
        most = std::max(most, farthest(before, stand));
      }
      return most;
    };
    const std::int32_t rate = kRate * static_cast<std::int32_t>(cycle_us) / 1000 + 2;
    run(60'000);
    SimulatedPort& port = offset_ ? bench.upstream : bench.downstream;
    for (const std::uint32_t outage_us : {4'000U, 13'000U, 25'000U}) {
      port.set_acknowledged(false);
      run(outage_us);
      const Joints before = stand;
      port.set_acknowledged(true);
      bench.turn();
      take_output();
      EXPECT_LE(farthest(before, stand), 15 * rate) << "as many sets as may wait";
      EXPECT_LE(run(10'000), rate) << outage_us;
    }
    bench.run_for(600'000);
  }
}

TEST_P(InlineOutputsTest, BusTakesNoFrames_IsReportedAsRefused) {
  settle_far();
  ASSERT_EQ(bench.read(0x1001, 0), 0U);
  bench.downstream.set_acknowledged(false);
  const std::uint32_t sets = bench.node().joint_counters().sets;
  for (int k = 0; k < 300; ++k) {
    bench.next_sync();
    bench.command_joints(kStand);
  }
  EXPECT_EQ(bench.read(0x1003, 1), kOutputRefused << 16 | kSetsWithheld);
  EXPECT_LE(bench.node().joint_counters().sets, sets + 20) << "within the limit";
}

// Disabled, the node fades out what the drives hold, also a correction from before the restart.
TEST_P(OutputsTest, DisabledBeforeTheFirstSet_FadesTheHeldCorrection) {
  settle_far();
  bench.power_on();
  take_output();
  for (int k = 0; k < 3; ++k) {
    bench.now_us += 1000;
    feed_back();
  }
  ASSERT_EQ(bench.write(0x2000, 2, 0, 1), 0U);
  bench.start_nodes();
  take_output();
  EXPECT_LE(rest(kStand, 1000), kRate);
  EXPECT_EQ(stand, kStand);
  EXPECT_EQ(bench.read(0x2001, 1), 0U) << "pass-through";
}

INSTANTIATE_TEST_SUITE_P(Modes, OutputsTest, ::testing::Values(Mode::kInline, Mode::kOffset),
                         mode_name);
INSTANTIATE_TEST_SUITE_P(Modes, InlineOutputsTest, ::testing::Values(Mode::kInline), mode_name);
INSTANTIATE_TEST_SUITE_P(Modes, OffsetOutputsTest, ::testing::Values(Mode::kOffset), mode_name);

}  // namespace
}  // namespace armtrue::canopen
