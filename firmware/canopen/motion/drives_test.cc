// The correction that the drives hold across restarts and changes of mode, in inline and offset
// mode, and frames that the joint path must ignore.
#include "firmware/core/table/test_image.h"
#include "firmware/testing/drives_bench.h"

namespace armtrue::canopen {
namespace {

TEST_P(DrivesTest, Restart_BeginsWithTheCorrectionThatTheDrivesHold) {
  settle();
  EXPECT_EQ(status() & kUnknownBit, 0U);
  const Joints before = stand;
  restart();
  EXPECT_EQ(status() & kUnknownBit, kUnknownBit);
  EXPECT_LE(rest(kStand, 200), kBlendStep);
  EXPECT_EQ(stand, before);
  EXPECT_EQ(seen, kStand) << "with the same correction taken off again";
  EXPECT_EQ(status() & kUnknownBit, 0U);
}

TEST_P(DrivesTest, RestartDuringABlend_ContinuesFromTheHeldCorrection) {
  settle();
  ASSERT_EQ(bench.write(0x2000, 2, 0, 1), 0U);
  rest(kStand, 8);
  const Joints before = stand;
  ASSERT_GT(farthest(before, kStand), 50);
  ASSERT_LT(farthest(before, kStand), 150);
  restart();
  EXPECT_LE(rest(kStand, 200), kBlendStep);
  EXPECT_GT(farthest(stand, kStand), 150) << "enabled again: that had not been saved";
}

TEST_P(DrivesTest, ControllerStartsAtReportedPosition_MakesNoStep) {
  settle();
  restart();
  for (int k = 0; k < 3; ++k) {
    bench.now_us += 1000;
    feed_back();
  }
  EXPECT_EQ(seen, stand) << "before the first set nothing is taken off";
  if (offset_) return;
  const Joints there = stand;
  EXPECT_LE(rest(there, 200), kBlendStep);
  EXPECT_EQ(seen, there);
}

TEST_P(DrivesTest, LateFeedback_IsUncorrectedFromTheFirstSetOn) {
  ASSERT_EQ(bench.write(0x2000, 7, 3, 1), 0U);
  ASSERT_EQ(bench.write(0x1010, 1, kSave, 4), 0U);
  settle();
  restart();
  expect_uncorrected_from_the_first_set(200, 3);
}

TEST_P(DrivesTest, FeedbackIsUncorrectedByTheDeltaOfItsOwnCycle) {
  ASSERT_EQ(bench.write(0x2000, 7, 2, 1), 0U);
  settle();
  std::vector<std::pair<Joints, Joints>> past;  // targets, drive positions
  for (int k = 0; k < 50; ++k) {
    cycle(moved(kStand, 1000 * k));
    past.emplace_back(target, stand);
    if (k < 5) continue;
    const auto& [then, stood] = past[past.size() - 3];
    const Joints now = stand;
    stand = stood;
    feed_back();
    stand = now;
    EXPECT_EQ(seen, then) << k;
  }
}

TEST_P(DrivesTest, WithoutFeedback_BeginsAtZeroAndSetsUnknownBit) {
  settle();
  restart();
  Joints first = {};
  for (int k = 0; k < 30; ++k) {
    bench.next_sync();
    bench.command_joints(kStand);
    take_output();
    if (outputs > 0 && first == Joints{}) first = stand;
  }
  EXPECT_LE(farthest(first, kStand), kBlendStep);
  EXPECT_NE(first, Joints{});
  EXPECT_EQ(status() & kUnknownBit, kUnknownBit);
}

TEST_P(DrivesTest, ChangeOfMode_ForgetsTheHeldCorrection) {
  settle();
  ASSERT_EQ(bench.write(0x2000, 2, 0, 1), 0U);
  rest(kStand, 200);
  bench.run_for(600'000);
  ASSERT_EQ(bench.write(0x2000, 1, 0, 1), 0U);
  ASSERT_EQ(bench.write(0x2000, 2, 1, 1), 0U);
  bench.run_for(600'000);
  EXPECT_EQ(status() & kUnknownBit, kUnknownBit) << "forward mode knows nothing";
  take_output();
  target = moved(kStand, 5000);
  stand = target;  // without a correction
  held = {};
  ASSERT_EQ(bench.write(0x2000, 1, static_cast<std::uint32_t>(GetParam()), 1), 0U);
  EXPECT_LE(rest(target, 200), kBlendStep);
  EXPECT_GT(farthest(stand, target), 100);
}

INSTANTIATE_TEST_SUITE_P(Modes, DrivesTest, ::testing::Values(Mode::kInline, Mode::kOffset),
                         mode_name);

// Inline: the drives stand still while the compensator is off.
class InlineDrivesTest : public DrivesTest {};

TEST_P(InlineDrivesTest, LateFeedback_IgnoresCorrectionsBeforeTheModeChange) {
  ASSERT_EQ(bench.write(0x2000, 7, 3, 1), 0U);
  settle();
  ASSERT_EQ(bench.write(0x2000, 2, 0, 1), 0U);
  rest(kStand, 200);
  bench.run_for(600'000);
  ASSERT_EQ(bench.write(0x2000, 1, 0, 1), 0U);
  ASSERT_EQ(bench.write(0x2000, 2, 1, 1), 0U);
  bench.run_for(600'000);
  take_output();
  stand = moved(kStand, kPermitted - 10);
  ASSERT_EQ(bench.write(0x2000, 1, static_cast<std::uint32_t>(Mode::kInline), 1), 0U);
  expect_uncorrected_from_the_first_set(30, 3);
}

TEST_P(InlineDrivesTest, FirstTargetFarAway_StartsAtNearestPermittedOutput) {
  settle();
  restart();
  const Joints before = stand;
  const Joints far = moved(kStand, 3000);
  cycle(far);
  ASSERT_EQ(outputs, 0) << "a stream begins with its second set";
  cycle(far);
  ASSERT_EQ(outputs, 3);
  for (std::size_t k = 0; k < 6; ++k) {
    EXPECT_LE(std::abs(stand[k] - before[k]), std::abs(far[k] - before[k])) << "joint " << k + 1;
    EXPECT_GE(stand[k], far[k] - kPermitted) << "joint " << k + 1;
    EXPECT_LE(stand[k], far[k] - kPermitted + kBlendStep) << "joint " << k + 1;
  }
  EXPECT_LE(rest(far, 100), kBlendStep);
  EXPECT_EQ(seen, far);
}

// The position of one drive has not come for longer than an arm may take to move away from it.
TEST_P(InlineDrivesTest, OldPosition_IsWaitedForAndReported) {
  for (const std::uint64_t age_us : {100'000U, 101'000U}) {
    SCOPED_TRACE(age_us);
    settle();
    restart();
    const auto feed_pair = [&](std::uint32_t pair) {
      bench.from_drives(NodeBench::pair_frame(0x1C0 + pair, stand[2 * pair], stand[2 * pair + 1]));
    };
    const auto command = [&] {
      bench.next_sync();
      bench.command_joints(kStand);
      take_output();
      return outputs;
    };
    feed_pair(1);
    bench.now_us += age_us - 2000;
    bench.turn();
    feed_pair(0);
    feed_pair(2);
    const Joints before = stand;
    ASSERT_EQ(command(), 0) << "a stream begins with its second set";
    if (age_us <= 100'000) {
      EXPECT_EQ(command(), 3);
      continue;
    }
    for (int k = 0; k < 120; ++k) {
      ASSERT_EQ(command(), 0) << k;
      feed_pair(0);
      feed_pair(2);
    }
    EXPECT_EQ(bench.read(0x1003, 1), kPositionUnknown << 16 | kSetsWithheld);
    feed_pair(1);
    EXPECT_LE(rest(kStand, 200), kBlendStep);
    EXPECT_EQ(stand, before) << "with the correction that the drives held";
    EXPECT_EQ(bench.read(0x1001, 0), 0U);
  }
}

TEST_P(InlineDrivesTest, LeavingOperational_KeepsTheKnownCorrection) {
  settle();
  bench.nmt(128);
  EXPECT_EQ(bench.node().nmt_state(), NmtState::kPreOperational) << "nothing to take back";
  bench.start_nodes();
  EXPECT_EQ(rest(kStand, 50), 0);
  EXPECT_EQ(status() & kUnknownBit, 0U);
}

// Without the mapping, the node does not know any more where the targets are in these frames.
TEST_P(InlineDrivesTest, MappingThatEndsUnderACorrection_WithholdsItsTargets) {
  ASSERT_EQ(bench.write(0x1011, 1, kLoad, 4), 0U) << "reset communication has the defaults";
  for (const bool is_reset : {true, false}) {
    SCOPED_TRACE(is_reset);
    settle();
    const Joints before = stand;
    nmt(is_reset ? 130 : 128);
    bench.run_for(600'000);
    if (!is_reset) {
      ASSERT_EQ(bench.write(0x1400, 1, 0x80000220, 4), 0U);
      ASSERT_EQ(bench.write(0x1401, 1, 0x80000320, 4), 0U);
    }
    for (int k = 0; k < 300; ++k) {
      cycle(moved(kStand, 30 * k));
      if (k == 150) bench.start_nodes();
      ASSERT_EQ(stand, before) << k;
    }
    EXPECT_EQ(bench.read(0x1003, 1), kNoSet << 16 | kSetsWithheld);
    EXPECT_EQ(bench.write(0x1400, 1, 0x220, 4), kDeviceState) << "joints are commanded";
    bench.run_for(600'000);
    bench.from_controller(NodeBench::pair_frame(0x240, 1, 2));
    EXPECT_EQ(bench.downstream.take_sent().size(), 1U) << "other frames pass";
    nmt(128);
    bench.configure(Mode::kInline);
    EXPECT_LE(rest(kStand, 100), kRate);
    EXPECT_EQ(seen, kStand);
    EXPECT_EQ(bench.read(0x1001, 0), 0U);
  }
}

TEST_P(InlineDrivesTest, MappingThatEndsWithoutACorrection_PassesItsFrames) {
  ASSERT_EQ(bench.write(0x1011, 1, kLoad, 4), 0U);
  settle();
  ASSERT_EQ(bench.write(0x2000, 2, 0, 1), 0U);
  rest(kStand, 100);
  nmt(130);
  cycle(moved(kStand, 30));
  EXPECT_EQ(stand, moved(kStand, 30));
}

INSTANTIATE_TEST_SUITE_P(Inline, InlineDrivesTest, ::testing::Values(Mode::kInline));

// Frames that the joint path must ignore.

TEST_P(InlineDrivesTest, NmtFromTheDrivesSide_IsForwardedButNotObeyed) {
  settle();
  bench.upstream.take_sent();
  bench.from_drives(make_frame(0, {2, 0}));
  EXPECT_EQ(bench.node().nmt_state(), NmtState::kOperational);
  const auto passed = bench.upstream.take_sent();
  ASSERT_EQ(passed.size(), 1U);
  EXPECT_EQ(passed[0].id, 0U);
}

TEST_P(InlineDrivesTest, SyncThatIsRemoteOrFromTheDrives_EndsNoInterval) {
  settle();
  CanFrame remote = make_frame(0x80, {});
  remote.flags = kFrameRemote;
  const auto frames = NodeBench::targets(kStand);
  bench.next_sync();
  bench.from_controller(frames[0]);
  bench.from_controller(remote);
  bench.from_controller(frames[1]);
  bench.from_drives(make_frame(0x80, {}));
  bench.from_controller(frames[2]);
  take_output();
  EXPECT_EQ(outputs, 3);
}

constexpr std::uint32_t kStreamBit = 1U << 1;  // of 0x2001 sub 2

// Backlash of joint 1: plus or minus 1 mrad by direction.
class BacklashTest : public DrivesTest {
 protected:
  BacklashTest() {
    armtrue::tests::TestImage made(6);
    made.add_state(format::State::kDirection, 0, 30);
    made.add_term(0, 1, 1e-3, 30);
    armtrue::tests::put(made.header(), format::header::kSequenceAt, std::uint32_t{2});
    bench.run_for(600'000);
    // Other drive resolution: corrections are disabled while it changes.
    EXPECT_EQ(bench.write(0x2000, 2, 0, 1), 0U);
    for (std::uint16_t k = 0; k < 6; ++k) {
      EXPECT_EQ(bench.write(static_cast<std::uint16_t>(0x608F + 0x800 * k), 1, 1U << 24, 4), 0U);
    }
    EXPECT_EQ(bench.write(0x2000, 2, 1, 1), 0U);
    bench.install(made.image());
    for (int k = 0; k < 300; ++k) cycle(there = moved({}, 200 * std::min(k, 100)));
    EXPECT_NEAR(stand[0] - there[0], kBacklash, 2);
  }
  void pause() {
    bench.run_for(30'000);
    EXPECT_EQ(status() & kStreamBit, 0U);
  }
  static constexpr std::int32_t kBacklash = -2670;  // 2^24 increments a turn
  Joints there = {};
};

TEST_P(BacklashTest, PauseAtRest_KeepsTheApproachDirection) {
  pause();
  EXPECT_EQ(rest(there, 200), 0);
  EXPECT_NEAR(stand[0] - there[0], kBacklash, 2);
}

TEST_P(BacklashTest, StartElsewhereAfterAPause_ForgetsApproachDirection) {
  pause();
  rest(there = moved(there, 500), 200);
  EXPECT_EQ(stand[0], there[0]) << "no direction, no backlash";
}

TEST_P(BacklashTest, MotionBeyondDeadBandInAPause_ForgetsDirection) {
  for (const std::int32_t way : {99, 101}) {
    SCOPED_TRACE(way);
    pause();
    for (const std::int32_t moved_by : {way, 0}) {
      Joints before = stand;
      stand[0] += moved_by;
      bench.now_us += 1000;
      feed_back();
      stand = before;
    }
    rest(there, 200);
    EXPECT_NEAR(stand[0] - there[0], way > 100 ? 0 : kBacklash, 2) << "dead band: 100";
  }
}

TEST_P(BacklashTest, ChangeOfModeAndBack_ForgetsApproachDirection) {
  ASSERT_EQ(bench.write(0x2000, 2, 0, 1), 0U);
  rest(there, 200);
  bench.run_for(600'000);
  ASSERT_EQ(bench.write(0x2000, 1, 0, 1), 0U);
  ASSERT_EQ(bench.write(0x2000, 2, 1, 1), 0U);
  bench.turn();
  ASSERT_EQ(bench.write(0x2000, 1, 1, 1), 0U);
  rest(there, 200);
  EXPECT_EQ(stand[0], there[0]);
}

TEST_P(BacklashTest, DriveMotionInAStream_KeepsApproachDirection) {
  stand[0] += 500;
  feed_back();
  rest(there, 200);
  EXPECT_NEAR(stand[0] - there[0], kBacklash, 2);
}

INSTANTIATE_TEST_SUITE_P(Inline, BacklashTest, ::testing::Values(Mode::kInline));

TEST_P(InlineDrivesTest, ReturningTemperature_EndsItsEmergency) {
  ASSERT_EQ(bench.write(0x2000, 6, 100, 4), 0U);
  ASSERT_EQ(bench.write(0x2020, 2, 2150, 2), 0U);
  take_output();
  bench.upstream.take_sent();
  bench.run_for(150'000);
  const auto raised = bench.upstream.take_sent();
  ASSERT_EQ(raised.size(), 1U);
  EXPECT_EQ(load_le<std::uint16_t>(raised[0].data), 0xFF12);
  EXPECT_EQ(raised[0].data[3], 2) << "which";
  ASSERT_EQ(bench.write(0x2020, 2, 2150, 2), 0U);
  bench.run_for(1000);
  std::vector<CanFrame> ended = bench.aside;
  for (const CanFrame& frame : bench.upstream.take_sent()) ended.push_back(frame);
  std::erase_if(ended, [](const CanFrame& frame) { return frame.id != 0xA0; });
  ASSERT_EQ(ended.size(), 1U);
  EXPECT_EQ(load_le<std::uint16_t>(ended[0].data), 0);
  EXPECT_EQ(load_le<std::uint16_t>(&ended[0].data[3]), 0xFF12);
  EXPECT_EQ(bench.read(0x1001, 0), 0U);
}

}  // namespace
}  // namespace armtrue::canopen
