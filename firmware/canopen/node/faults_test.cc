// Faults that ordinary frames could cause, one by one through the node's own objects. Each test
// failed before its fix (docs/security.md, "Faults that were found").
#include <gtest/gtest.h>

#include "firmware/canopen/node/bus_watch.h"
#include "firmware/core/evaluation/terms.h"
#include "firmware/testing/drives_bench.h"

namespace armtrue::canopen {
namespace {

class FaultTest : public DrivesTest {
 protected:
  // Codes of the emergencies that have been sent.
  std::vector<int> emergencies() {
    std::vector<CanFrame> frames = std::exchange(bench.aside, {});
    for (const CanFrame& frame : bench.upstream.take_sent()) frames.push_back(frame);
    std::vector<int> codes;
    for (const CanFrame& frame : frames) {
      if (frame.id == 0x80U + NodeBench::kNodeId)
        codes.push_back(load_le<std::uint16_t>(frame.data));
    }
    return codes;
  }
  bool reported(int code) {
    const std::vector<int> codes = emergencies();
    return std::find(codes.begin(), codes.end(), code) != codes.end();
  }
  std::uint32_t refusal() { return bench.read(0x2013, 2); }
  // RPDO 13 receives these objects of the drives on 0x1D0.
  void hear_of_drives(std::initializer_list<std::uint32_t> objects) {
    ASSERT_EQ(bench.write(0x140C, 1, 0x800001D0, 4), 0U);
    ASSERT_EQ(bench.write(0x160C, 0, 0, 1), 0U);
    std::uint8_t count = 0;
    for (const std::uint32_t object : objects)
      ASSERT_EQ(bench.write(0x160C, ++count, object, 4), 0U);
    ASSERT_EQ(bench.write(0x160C, 0, count, 1), 0U);
    ASSERT_EQ(bench.write(0x140C, 1, 0x1D0, 4), 0U);
  }
};
class InlineFaultTest : public FaultTest {};
class OffsetFaultTest : public FaultTest {};

TEST_P(InlineFaultTest, UnverifiedTableBytes_DoNotAffectTheOutput) {
  settle();
  bench.run_for(1'200'000);  // the drives are silent: commits are allowed
  ASSERT_EQ(bench.write(0x2000, 2, 0, 1), 0U);
  const auto image = TestTable{.magnitude = kPermitted << 12}.image();
  bench.install(image);
  const std::vector<std::uint8_t> junk(image.size(), 0xA5);
  ASSERT_EQ(bench.stage(junk), 0U);
  take_output();
  EXPECT_LE(rest(kStand, 200), kRate);
  EXPECT_EQ(stand, kStand) << "disabled";
}

// SDO refuses such mappings; parameters may have been saved by a firmware that accepted them.
TEST_P(InlineFaultTest, MoreTargetPdosThanAxes_FormNoSetAndAreReported) {
  constexpr std::uint32_t kMany = 19;
  ObjectDictionary saved;
  saved.restore_defaults(NodeBench::kNodeId);
  saved.set(od::compensator_control::kMode, static_cast<std::uint8_t>(Mode::kInline));
  for (std::uint32_t k = 0; k < kMany; ++k) {
    saved.set(od::rpdo::kCOBID[k], 0x300U + k);
    saved.set(od::rpdo::kMappingCount[k], 1);
    saved.set(od::rpdo::kMapping[k], (0x607AU + 0x800U * (k % 6)) << 16 | 0x20U);
  }
  ASSERT_TRUE(save_parameters(saved, bench.parameters));
  restart();
  emergencies();
  for (std::uint32_t k = 0; k < kMany; ++k) {
    bench.from_controller(make_frame(0x300 + k, {1, 0, 0, 0}));
  }
  EXPECT_TRUE(reported(0xFF15));
  EXPECT_EQ(status() & 1U, 0U) << "not configured";
}

// A controller whose three frames take longer than the default set window.
class SlowFramesTest : public InlineFaultTest {
 protected:
  int sets_out(int cycles, bool with_sync) {
    int sets = 0;
    for (int k = 0; k < cycles; ++k) {
      if (with_sync) bench.sync();
      outputs = 0;
      std::int32_t frames = 0;
      for (const CanFrame& frame : NodeBench::targets(moved(kStand, 10 * k))) {
        bench.from_controller(frame);
        take_output();
        frames += outputs;
        bench.now_us += 270;
        bench.turn();
      }
      bench.now_us += 190;
      bench.turn();
      sets += frames == 3;
    }
    return sets;
  }
};

TEST_P(SlowFramesTest, WithSync_SetsGoOut) { EXPECT_GE(sets_out(5000, true), 4998); }

TEST_P(SlowFramesTest, WithoutSync_TheWindowIsLearntAndSetsGoOut) {
  sets_out(20, false);
  EXPECT_EQ(sets_out(1000, false), 1000);
  EXPECT_GT(bench.read(0x2006, 13), 540U) << "the window in force";
  EXPECT_LT(bench.read(0x2006, 13), 730U) << "ahead of what could be another cycle's";
}

TEST_P(SlowFramesTest, IncompleteSets_RaiseEmergency) {
  settle();
  emergencies();
  for (int k = 0; k < 150; ++k) {
    bench.now_us += 1000;
    const auto frames = NodeBench::targets(kStand);
    bench.from_controller(frames[0]);
    bench.from_controller(frames[1]);
  }
  EXPECT_TRUE(reported(0xFF15));
  EXPECT_NE(bench.read(0x1001, 0), 0U);
  rest(kStand, 10);
  emergencies();
  EXPECT_EQ(bench.read(0x1001, 0), 0U) << "over with the next set that goes out";
}

TEST_P(InlineFaultTest, SynchronousTargets_AreComputedBeforeSync) {
  bench.run_for(600'000);
  bench.set_transmission(0x1400);
  for (int k = 0; k < 5; ++k) {
    bench.next_sync();
    bench.command_joints(kStand);
  }
  bench.downstream.take_sent();
  const std::uint32_t before = bench.compensator().counters().cycles;
  bench.next_sync();
  EXPECT_EQ(bench.compensator().counters().cycles, before) << "nothing is evaluated ahead of SYNC";
  const auto sent = bench.downstream.take_sent();
  ASSERT_EQ(sent.size(), 4U);
  EXPECT_EQ(sent[3].id, 0x80U) << "the drives take the targets at this SYNC";
}

TEST_P(OffsetFaultTest, TableOfLowRate_NmtCommandsStillZeroOffsets) {
  for (const int command : {2, 128, 129, 130}) {
    SCOPED_TRACE(command);
    settle();
    wait(600);
    const auto image = TestTable{.sequence = 2, .magnitude = kPermitted << 12, .rate = 500}.image();
    ASSERT_EQ(bench.stage(image), 0U);
    if (bench.command(TableCommand::kVerify) == 0) {
      ASSERT_EQ(bench.command(TableCommand::kCommit), 0U);
      ASSERT_EQ(bench.command(TableCommand::kActivate), 0U);
    }
    nmt(command);
    EXPECT_LE(wait(6000), kRate);
    EXPECT_NE(state(), NmtState::kOperational);
    EXPECT_EQ(held, Joints{});
    bench.start_nodes();
    take_output();
  }
}

TEST_P(OffsetFaultTest, PendingStopAndReset_AreNotLostDuringTheFade) {
  bench.install(
      TestTable{.sequence = 2, .magnitude = kPermitted << 12, .rate = kMaxRateRevolute / 40}
          .image());
  settle();
  rest(kStand, 400);
  nmt(2);
  wait(30);
  ASSERT_EQ(state(), NmtState::kOperational) << "the offsets still fade";
  nmt(0x4D);
  wait(300);
  EXPECT_EQ(state(), NmtState::kStopped);
  bench.start_nodes();
  settle();
  rest(kStand, 400);
  const std::uint64_t lives = bench.lives;
  nmt(129);
  wait(5);
  nmt(1);
  wait(300);
  EXPECT_EQ(bench.lives, lives + 1) << "a reset is not undone by a start behind it";
}

TEST_P(FaultTest, ATableForOtherEncodersIsRefused) {
  EXPECT_EQ(bench.read(0x608F, 1), 1U << 20) << "as the table in force says";
  EXPECT_EQ(bench.read(0x608F, 2), 1U);
  settle();
  bench.run_for(600'000);
  const auto finer = TestTable{.sequence = 2, .magnitude = kPermitted << 12, .finer = 4}.image();
  ASSERT_EQ(bench.stage(finer), 0U);
  EXPECT_NE(bench.command(TableCommand::kVerify), 0U);
  EXPECT_EQ(refusal(), 22U);
  EXPECT_EQ(bench.write(0x608F, 1, 1U << 24, 4), static_cast<std::uint32_t>(Abort::kDeviceState))
      << "not under a correction";
  EXPECT_LE(rest(kStand, 50), kRate);
}

TEST_P(FaultTest, ChangeOfResolution_NeedsDisabledDrives) {
  ASSERT_EQ(bench.write(0x2000, 2, 0, 1), 0U);
  hear_of_drives({0x60410010});
  const auto drive_says = [this](int statusword) {
    const CanFrame frame = make_frame(0x1D0, {statusword & 0xFF, statusword >> 8});
    offset_ ? bench.from_controller(frame) : bench.from_drives(frame);
  };
  drive_says(kOperationEnabled);
  EXPECT_EQ(bench.write(0x608F, 1, 1U << 24, 4), static_cast<std::uint32_t>(Abort::kDeviceState));
  drive_says(kSwitchOnDisabled);
  bench.run_for(1'100'000);  // the other five say nothing
  EXPECT_EQ(bench.write(0x608F, 1, 1U << 24, 4), 0U);
  EXPECT_EQ(bench.write(0x2000, 2, 1, 1), 0U);
  EXPECT_EQ(refusal(), 22U) << "the table in force is one of the drives that were";
  EXPECT_EQ(bench.read(0x2001, 1), 0U) << "pass-through";
}

TEST_P(InlineFaultTest, BackToBackSets_DoNotSpeedUpTheCorrection) {
  settle();
  ASSERT_EQ(bench.write(0x2000, 2, 0, 1), 0U);
  take_output();
  bench.run_for(30'000);  // SYNC is not in use any more
  Joints begun = stand;
  int sets = 0;
  for (int k = 0; k < 20; ++k) {
    bench.now_us += 70;
    bench.command_joints(kStand);
    take_output();
    if (outputs == 0) continue;
    // The whole correction takes 20 ms: the first step, after a pause, is that of one control
    // period; then less than an increment in 70 us.
    EXPECT_LE(farthest(stand, begun), sets == 0 ? 10 : sets + 1) << k;
    if (++sets == 1) begun = stand;
  }
  EXPECT_GE(sets, 10);
}

TEST_P(InlineFaultTest, FrameWaitingForSync_IsNotReadByALaterMapping) {
  ASSERT_EQ(bench.write(0x1412, 2, 1, 1), 0U);
  ASSERT_EQ(bench.write(0x1412, 1, 0x1F0, 4), 0U);
  bench.from_controller(make_frame(0x1F0, {0x88, 0x13, 0, 0}));
  ASSERT_EQ(bench.write(0x1412, 1, 0x800001F0, 4), 0U);
  ASSERT_EQ(bench.write(0x1612, 0, 0, 1), 0U);
  ASSERT_EQ(bench.write(0x1612, 1, 0x20200110, 4), 0U);
  ASSERT_EQ(bench.write(0x1612, 0, 1, 1), 0U);
  ASSERT_EQ(bench.write(0x1412, 1, 0x1F0, 4), 0U);
  bench.sync();
  EXPECT_EQ(bench.read(0x2020, 1), 0U) << "5000 g are not 50 degrees";
}

TEST_P(InlineFaultTest, PayloadByPdoOutOfBounds_IsRefusedAndReported) {
  ASSERT_EQ(bench.write(0x1412, 1, 0x1F0, 4), 0U);
  bench.from_controller(make_frame(0x1F0, {0x88, 0x13, 0, 0}));
  EXPECT_EQ(bench.read(0x2021, 0), 5000U);
  emergencies();
  bench.from_controller(make_frame(0x1F0, {0xFF, 0xFF, 0xFF, 0xFF}));
  EXPECT_TRUE(reported(0xFF18));
  EXPECT_EQ(bench.read(0x2021, 0), 5000U);
}

TEST_P(FaultTest, ScaleWrite_WhileDrivesOfUnknownStateSend_IsRefused) {
  settle();
  ASSERT_EQ(bench.write(0x2000, 2, 0, 1), 0U);
  rest(kStand, 200);
  for (int k = 0; k < 600; ++k) {
    wait(1);
    feed_back();
  }
  ASSERT_EQ(bench.read(0x2001, 1), 0U);
  EXPECT_EQ(bench.write(0x608F, 1, 1U << 24, 4), static_cast<std::uint32_t>(Abort::kDeviceState));
}

// A correction that drives hold is not cut off by a write: that would be a step.
TEST_P(FaultTest, PdoChange_WhileDrivesHoldACorrection_IsRefused) {
  settle();
  bench.run_for(600'000);
  const auto refused = static_cast<std::uint32_t>(Abort::kDeviceState);
  EXPECT_EQ(bench.write(0x1400, 1, 0x80000220, 4), refused);
  EXPECT_EQ(bench.write(0x1401, 1, 0x220, 4), refused) << "ahead of the one that has it";
  EXPECT_EQ(bench.write(0x1800, 1, 0xC00001A0, 4), refused);
  EXPECT_EQ(bench.write(0x1005, 0, 0x220, 4), refused) << "SYNC passes as it is";
  EXPECT_EQ(bench.write(0x2000, 1, 0, 1), offset_ ? 0U : refused);
  if (offset_) return;
  EXPECT_EQ(bench.write(0x2000, 1, 1, 1), 0U) << "that is the mode";
  EXPECT_LE(rest(kStand, 200), kRate);
  ASSERT_EQ(bench.write(0x2000, 2, 0, 1), 0U);
  rest(kStand, 200);
  bench.run_for(600'000);
  EXPECT_EQ(bench.write(0x1400, 1, 0x80000220, 4), 0U) << "nothing is held any more";
  EXPECT_EQ(bench.write(0x2000, 1, 0, 1), 0U);
}

TEST_P(InlineFaultTest, PdosRewrittenInPreOperational_MakeNoStep) {
  settle();
  bench.run_for(600'000);
  nmt(128);
  EXPECT_EQ(bench.write(0x1400, 1, 0x80000220, 4), 0U);
  EXPECT_EQ(bench.write(0x1400, 1, 0x220, 4), 0U);
  nmt(1);
  EXPECT_LE(rest(kStand, 50), kRate);
}

TEST_P(FaultTest, FeedbackDelayWrittenInMotion_IsRefused) {
  settle();
  EXPECT_EQ(bench.write(0x2000, 7, 8, 1), static_cast<std::uint32_t>(Abort::kDeviceState))
      << "actual positions would make a step";
}

TEST_P(FaultTest, ResetCommunication_KeepsTheEnableSwitch) {
  settle();
  ASSERT_EQ(bench.write(0x2000, 2, 0, 1), 0U);
  rest(kStand, 100);
  nmt(130);
  bench.run_for(10'000);
  EXPECT_EQ(bench.read(0x2001, 1), 0U);
  EXPECT_EQ(bench.read(0x2000, 2), 0U);
}

TEST_P(FaultTest, TableRefusedWhenEnabled_FreesItsBuffer) {
  ASSERT_EQ(bench.write(0x2000, 2, 0, 1), 0U);
  for (std::uint16_t k = 0; k < 6; ++k) {
    const auto resolution = static_cast<std::uint16_t>(0x608F + 0x800 * k);
    ASSERT_EQ(bench.write(resolution, 1, 1U << 24, 4), 0U);
  }
  ASSERT_EQ(bench.write(0x2000, 2, 1, 1), 0U);
  ASSERT_EQ(refusal(), 22U);
  ASSERT_EQ(bench.write(0x2000, 2, 0, 1), 0U);
  bench.install(TestTable{.sequence = 2, .magnitude = kPermitted << 12, .finer = 4}.image());
  EXPECT_EQ(bench.stage(TestTable{.sequence = 3, .finer = 4}.image()), 0U);
}

TEST_P(FaultTest, DriveStateNoLongerMapped_IsForgotten) {
  ASSERT_EQ(bench.write(0x2000, 1, 0, 1), 0U);
  hear_of_drives({0x60410010, 0x68610008});
  bench.from_controller(make_frame(0x1D0, {0x50, 0x02, 6}));
  EXPECT_EQ(bench.read(0x2005, 1), 3U);
  EXPECT_EQ(bench.read(0x2005, 2), 3U);
  ASSERT_EQ(bench.write(0x140C, 1, 0x800001D0, 4), 0U);
  EXPECT_EQ(bench.read(0x2005, 1), 0U);
  EXPECT_EQ(bench.read(0x2005, 2), 0U);
}

// 0xFF15 is raised whenever targets come and no set goes out.
class WithheldTest : public FaultTest {
 protected:
  // The reason that 0xFF15 gives for withheld sets; 0 if it was not sent.
  int why(int milliseconds, int period_ms = 1, std::size_t frames = 3) {
    bench.upstream.take_sent();
    bench.aside.clear();
    for (int k = 0; k < milliseconds; k += period_ms) {
      bench.run_for(static_cast<std::uint64_t>(period_ms) * 1000);
      const auto targets = NodeBench::targets(moved(kStand, k));
      for (std::size_t f = 0; f < frames; ++f) bench.from_controller(targets[f]);
    }
    int reason = 0;
    for (const CanFrame& frame : bench.upstream.take_sent()) {
      const bool is_ours = frame.id == 0x80U + NodeBench::kNodeId;
      if (is_ours && load_le<std::uint16_t>(frame.data) == 0xFF15) reason = frame.data[3];
    }
    return reason;
  }
};
class InlineWithheldTest : public WithheldTest {};
class OffsetWithheldTest : public WithheldTest {};

TEST_P(WithheldTest, ControllerSlowerThanTheStaleTimeOut_IsReported) {
  settle();
  EXPECT_EQ(why(500, 25, 2), 1);
}

TEST_P(InlineWithheldTest, NodeNotOperational_IsReported) {
  settle();
  nmt(128);
  EXPECT_EQ(why(200), 6);
  nmt(1);
  rest(kStand, 10);
  emergencies();
  EXPECT_EQ(bench.read(0x1001, 0), 0U);
}

TEST_P(InlineWithheldTest, SetsRefusedByTheDrivesBus_AreReportedAndUndone) {
  settle();
  const Joints before = stand;
  ASSERT_EQ(bench.write(0x2000, 2, 0, 1), 0U);
  bench.downstream.set_room(0);
  EXPECT_EQ(why(300), 7);
  bench.downstream.set_room(SIZE_MAX);
  bench.command_joints(kStand);
  take_output();
  EXPECT_LE(farthest(before, stand), kBlendStep) << "it goes on from what the drives hold";
}

TEST_P(OffsetWithheldTest, OffsetOfAJointInNoTpdo_IsReported) {
  ASSERT_EQ(bench.write(0x1801, 1, 0xC00002A0, 4), 0U);
  EXPECT_EQ(why(10), 5);
  EXPECT_EQ(status() & 1U, 0U) << "not configured";
}

TEST_P(OffsetWithheldTest, OffsetsWithoutSync_AreReportedAndDoNotRunAhead) {
  bench.set_transmission(0x1800);
  EXPECT_EQ(why(500), 4);
  target = stand = kStand;
  EXPECT_LE(rest(kStand, 200), kBlendStep);
  EXPECT_GT(farthest(stand, kStand), 150);
}

TEST_P(InlineFaultTest, BlockDownloadOfATargetToADrive_IsReported) {
  emergencies();
  bench.from_controller(make_frame(0x601, {0xC6, 0x7A, 0x60, 0, 4, 0, 0, 0}));
  EXPECT_TRUE(reported(0xFF13));
}

TEST(TimeTest, TimeOfMilliseconds_DoesNotDecreaseIn400Days) {
  std::int32_t last = 0;
  for (std::uint64_t day = 1; day < 400; ++day) {
    const std::int32_t now = time_of_milliseconds(day * 86'400'000);
    EXPECT_GE(now, last) << day;
    last = now;
  }
}

TEST_P(InlineFaultTest, LiveSensor_DoesNotEndTheErrorOfASilentOne) {
  ASSERT_EQ(bench.write(0x2000, 6, 100, 4), 0U);
  ASSERT_EQ(bench.write(0x2020, 1, 2150, 2), 0U);
  for (int k = 0; k < 30; ++k) {
    ASSERT_EQ(bench.write(0x2020, 2, 2150, 2), 0U);
    bench.run_for(10'000);
  }
  EXPECT_NE(bench.read(0x1001, 0), 0U);
  ASSERT_EQ(bench.write(0x2020, 1, 2150, 2), 0U);
  EXPECT_EQ(bench.read(0x1001, 0), 0U);
}

TEST_P(InlineFaultTest, LostHeartbeats_AreReportedUntilNoLongerWatched) {
  ASSERT_EQ(bench.write(0x1016, 1, 0x00050064, 4), 0U);
  ASSERT_EQ(bench.write(0x1016, 2, 0x000600C8, 4), 0U);
  bench.from_controller(make_frame(0x705, {5}));
  bench.from_controller(make_frame(0x706, {5}));
  bench.run_for(300'000);
  const std::vector<int> codes = emergencies();
  EXPECT_EQ(std::count(codes.begin(), codes.end(), 0x8130), 2);
  ASSERT_EQ(bench.write(0x1016, 1, 0, 4), 0U);
  EXPECT_NE(bench.read(0x1001, 0), 0U) << "the other is still lost";
  ASSERT_EQ(bench.write(0x1016, 2, 0, 4), 0U);
  EXPECT_EQ(bench.read(0x1001, 0), 0U);
}

TEST_P(InlineFaultTest, ResetCommunication_ReportsABusStillPassiveOrOff) {
  for (const BusState state : {BusState::kPassive, BusState::kBusOff}) {
    bench.downstream.set_state(state);
    bench.run_for(10'000);
    EXPECT_NE(bench.read(0x1001, 0), 0U);
    nmt(130);
    bench.run_for(10'000);
    EXPECT_NE(bench.read(0x1001, 0), 0U);
  }
}

TEST_P(InlineFaultTest, DamagedParametersAreReported) {
  bench.parameters.spoil(100);
  bench.power_on();
  EXPECT_TRUE(reported(0x5530));
  EXPECT_EQ(bench.read(0x1003, 1), 0x01015530U);
}

INSTANTIATE_TEST_SUITE_P(Modes, FaultTest, ::testing::Values(Mode::kInline, Mode::kOffset));
INSTANTIATE_TEST_SUITE_P(Modes, WithheldTest, ::testing::Values(Mode::kInline, Mode::kOffset));
INSTANTIATE_TEST_SUITE_P(Inline, InlineWithheldTest, ::testing::Values(Mode::kInline));
INSTANTIATE_TEST_SUITE_P(Offset, OffsetWithheldTest, ::testing::Values(Mode::kOffset));
INSTANTIATE_TEST_SUITE_P(Inline, InlineFaultTest, ::testing::Values(Mode::kInline));
INSTANTIATE_TEST_SUITE_P(Inline, SlowFramesTest, ::testing::Values(Mode::kInline));
INSTANTIATE_TEST_SUITE_P(Offset, OffsetFaultTest, ::testing::Values(Mode::kOffset));

}  // namespace
}  // namespace armtrue::canopen
