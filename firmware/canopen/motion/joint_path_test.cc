// What reaches the drives and the controller when frames are lost, late, repeated or malformed.
#include "firmware/canopen/motion/joint_path.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <map>

#include "firmware/testing/node_bench.h"
#include "firmware/testing/test_table.h"

namespace armtrue::canopen {
namespace {

using Joints = std::array<std::int32_t, 6>;

// A slow move; every joint at its own pace.
Joints at_cycle(int cycle) {
  Joints joints = {};
  for (std::size_t k = 0; k < joints.size(); ++k) {
    joints[k] = static_cast<std::int32_t>(100000 + 20 * cycle * static_cast<int>(k + 1));
  }
  return joints;
}

// The targets in the frames that left downstream; other frames are skipped.
Joints released(const std::vector<CanFrame>& frames) {
  Joints joints = {};
  for (const CanFrame& frame : frames) {
    if (frame.id != 0x220 && frame.id != 0x320 && frame.id != 0x420) continue;
    const std::size_t first = 2 * (frame.id / 0x100 - 2);
    joints[first] = load_le<std::int32_t>(&frame.data[0]);
    joints[first + 1] = load_le<std::int32_t>(&frame.data[4]);
  }
  return joints;
}

std::size_t count_targets(const std::vector<CanFrame>& frames) {
  return static_cast<std::size_t>(std::count_if(
      frames.begin(), frames.end(),
      [](const CanFrame& f) { return f.id == 0x220 || f.id == 0x320 || f.id == 0x420; }));
}

class InlineTest : public testing::Test {
 protected:
  InlineTest() {
    bench.install(TestTable{}.image());
    bench.configure(Mode::kInline);
    bench.downstream.take_sent();
    bench.upstream.take_sent();
  }
  // One cycle of 1 ms: SYNC, then all targets. Returns the frames that left downstream.
  std::vector<CanFrame> cycle(int number) {
    bench.next_sync();
    bench.command_joints(at_cycle(number));
    return bench.downstream.take_sent();
  }
  void run(int from, int to) {
    for (int k = from; k < to; ++k) cycle(k);
  }
  NodeBench bench;
};

TEST_F(InlineTest, Targets_AreRewrittenByTheCompensatorsCorrection) {
  run(0, 100);
  const Joints out = released(cycle(100));
  const Joints in = at_cycle(100);
  for (std::size_t k = 0; k < 6; ++k) {
    // Size and sign of the correction: TestTable's amplitude times the sine of the joint's angle.
    const double angle = 2.0 * M_PI * in[k] / std::pow(2.0, 20);
    EXPECT_NE(out[k], in[k]);
    EXPECT_LT(std::abs(out[k] - in[k]), 20000);
    EXPECT_EQ(std::signbit(in[k] - out[k]), std::signbit(std::sin(angle))) << "joint " << k;
  }
}

TEST_F(InlineTest, WithoutATable_TargetsPassUnchanged) {
  NodeBench plain;
  plain.configure(Mode::kInline);
  plain.downstream.take_sent();
  plain.command_joints(at_cycle(2));
  plain.run_for(1000, 100);
  EXPECT_EQ(count_targets(plain.downstream.take_sent()), 0U)
      << "a stream begins with its second set";
  plain.command_joints(at_cycle(3));
  const std::vector<CanFrame> frames = plain.downstream.take_sent();
  ASSERT_EQ(frames.size(), 3U);
  EXPECT_EQ(released(frames), at_cycle(3));
}

TEST_F(InlineTest, LostFrame_WithholdsItsSetAndTheNext) {
  run(0, 10);
  const auto frames = NodeBench::targets(at_cycle(10));
  bench.next_sync();
  bench.from_controller(frames[1]);
  bench.from_controller(frames[2]);
  EXPECT_EQ(count_targets(bench.downstream.take_sent()), 0U);
  EXPECT_EQ(count_targets(cycle(11)), 0U) << "the frame could have been late, not lost";
  EXPECT_EQ(count_targets(cycle(12)), 3U);
  EXPECT_EQ(bench.node().joint_counters().withheld, 1U + 2U) << "the first of the stream as well";
}

TEST_F(InlineTest, LateFrame_IsNotUsedForTheNextSet) {
  run(0, 10);
  const auto frames = NodeBench::targets(at_cycle(10));
  bench.next_sync();
  bench.from_controller(frames[0]);
  bench.from_controller(frames[1]);
  bench.next_sync();
  bench.from_controller(frames[2]);  // late, then the whole next set
  bench.command_joints(at_cycle(11));
  EXPECT_EQ(count_targets(bench.downstream.take_sent()), 0U);
  EXPECT_EQ(count_targets(cycle(12)), 0U);
  EXPECT_EQ(count_targets(cycle(13)), 3U);
}

TEST_F(InlineTest, WithoutSync_TheSetWindowSeparatesCycles) {
  ASSERT_EQ(bench.write(0x2000, 4, 500, 4), 0U);
  const auto lossy = NodeBench::targets(at_cycle(10));
  for (const int number : {8, 9}) {
    bench.command_joints(at_cycle(number));
    bench.run_for(1000, 100);
  }
  bench.downstream.take_sent();
  bench.from_controller(lossy[1]);
  bench.from_controller(lossy[2]);
  bench.run_for(1000, 100);
  bench.command_joints(at_cycle(11));
  EXPECT_EQ(count_targets(bench.downstream.take_sent()), 0U) << "after one that was not whole";
  bench.run_for(1000, 100);
  bench.command_joints(at_cycle(12));
  EXPECT_EQ(count_targets(bench.downstream.take_sent()), 3U);
  EXPECT_EQ(bench.node().joint_counters().sets, 2U);
}

TEST_F(InlineTest, RepeatedFrame_IsCountedAndIgnored) {
  run(0, 10);
  const auto frames = NodeBench::targets(at_cycle(10));
  bench.next_sync();
  for (const CanFrame& frame : {frames[0], frames[0], frames[1], frames[2], frames[2]}) {
    bench.from_controller(frame);
  }
  const std::vector<CanFrame> out = bench.downstream.take_sent();
  EXPECT_EQ(count_targets(out), 3U);
  EXPECT_EQ(count_targets(cycle(11)), 3U);
  EXPECT_EQ(bench.node().joint_counters().withheld, 1U) << "the first of the stream";
  EXPECT_EQ(bench.node().joint_counters().repeated, 2U);
}

TEST_F(InlineTest, SecondController_IsReportedAndSetsAreNotMixed) {
  run(0, 10);
  const auto ours = NodeBench::targets(at_cycle(10));
  const auto theirs = NodeBench::targets(at_cycle(5000));
  bench.next_sync();
  for (const CanFrame& frame : {ours[0], theirs[0], ours[1], ours[2]}) bench.from_controller(frame);
  EXPECT_EQ(count_targets(bench.downstream.take_sent()), 0U) << "contradiction before it is whole";
  EXPECT_EQ(count_targets(cycle(10)), 0U);
  bench.next_sync();
  for (const CanFrame& frame : ours) bench.from_controller(frame);
  for (const CanFrame& frame : theirs) bench.from_controller(frame);
  const std::vector<CanFrame> out = bench.downstream.take_sent();
  EXPECT_EQ(count_targets(out), 3U) << "one set for each SYNC";
  EXPECT_NEAR(released(out)[0], at_cycle(10)[0], 2000);
  EXPECT_EQ(bench.read(0x2001, 16), 4U);
  EXPECT_EQ(bench.read(0x1003, 1) & 0xFFFFU, 0xFF14U);
  run(11, 105);
  EXPECT_NE(bench.read(0x1001, 0), 0U);
  run(105, 130);
  EXPECT_EQ(bench.read(0x1001, 0), 0U) << "over after a hundred clean sets";
}

TEST_F(InlineTest, MappingAndMode_CannotChangeDuringAStream) {
  run(0, 10);
  EXPECT_EQ(bench.write(0x1400, 1, 0x80000220, 4), static_cast<std::uint32_t>(Abort::kDeviceState));
  EXPECT_EQ(bench.write(0x2000, 1, 0, 1), static_cast<std::uint32_t>(Abort::kDeviceState));
}

TEST_F(InlineTest, AnyFrameOrderWithinACycle_IsAcceptedAndKept) {
  run(0, 10);
  const auto frames = NodeBench::targets(at_cycle(10));
  bench.next_sync();
  for (const std::size_t k : {2, 0, 1}) bench.from_controller(frames[k]);
  std::vector<CanFrame> out = bench.downstream.take_sent();
  std::erase_if(out, [](const CanFrame& frame) { return frame.id == 0x80; });
  ASSERT_EQ(out.size(), 3U);
  EXPECT_EQ(out[0].id, 0x420U);
  EXPECT_EQ(out[1].id, 0x220U);
  EXPECT_EQ(out[2].id, 0x320U);
}

TEST_F(InlineTest, StaleInput_StopsOutputAndRaisesEmergency) {
  run(0, 10);
  bench.upstream.take_sent();
  bench.run_for(30'000);
  EXPECT_EQ(count_targets(bench.downstream.take_sent()), 0U);
  const std::vector<CanFrame> sent = bench.upstream.take_sent();
  ASSERT_EQ(sent.size(), 1U);
  EXPECT_EQ(sent[0].id, 0xA0U);
  EXPECT_EQ(load_le<std::uint16_t>(sent[0].data), 0xFF10);
  EXPECT_EQ(bench.read(0x1001, 0), 0x11U);
  cycle(11);
  cycle(12);
  const std::vector<CanFrame> again = bench.upstream.take_sent();
  ASSERT_EQ(again.size(), 1U);
  EXPECT_EQ(load_le<std::uint16_t>(again[0].data), 0x0000) << "error reset";
  EXPECT_EQ(bench.read(0x1001, 0), 0U);
}

TEST_F(InlineTest, InterruptedStream_RestartsWithItsSecondSet) {
  run(0, 40);
  bench.run_for(30'000);  // no targets: stale
  ASSERT_EQ(bench.node().joint_counters().stale, 1U);
  EXPECT_EQ(count_targets(cycle(39)), 0U) << "a stream begins with its second set";
  EXPECT_EQ(count_targets(cycle(39)), 3U);
  bench.next_sync();  // an interval without targets
  EXPECT_EQ(count_targets(cycle(39)), 0U);
  EXPECT_EQ(count_targets(cycle(39)), 3U);
}

TEST_F(InlineTest, SyncWithCounter_ReleasesTargets) {
  bench.set_transmission(0x1400);
  ASSERT_EQ(bench.write(0x1019, 0, 10, 1), 0U);
  for (int number = 1; number <= 10; ++number) {
    bench.now_us += 1000;
    bench.downstream.take_sent();
    bench.from_controller(make_frame(0x80, {number}));
    EXPECT_EQ(count_targets(bench.downstream.take_sent()), number < 3 ? 0U : 3U) << number;
    bench.command_joints(at_cycle(number));
  }
  bench.sync();
  EXPECT_EQ(count_targets(bench.downstream.take_sent()), 0U) << "none that is of this bus";
}

TEST_F(InlineTest, ShortTargetFrame_WithholdsItsSetAndIsReported) {
  run(0, 10);
  auto frames = NodeBench::targets(at_cycle(10));
  frames[1].len = 7;
  bench.next_sync();
  for (const CanFrame& frame : frames) bench.from_controller(frame);
  EXPECT_EQ(count_targets(bench.downstream.take_sent()), 0U);
  EXPECT_EQ(bench.node().joint_counters().malformed, 1U);
  EXPECT_EQ(bench.read(0x1003, 1) & 0xFFFFU, 0x8210U);
  run(11, 110);
  EXPECT_NE(bench.read(0x1001, 0), 0U);
  run(110, 113);
  EXPECT_EQ(bench.read(0x1001, 0), 0U) << "a hundred came out whole";
}

TEST_F(InlineTest, LongerTargetFrame_KeepsItsFurtherBytes) {
  NodeBench fd(true, true);
  fd.configure(Mode::kInline);
  fd.downstream.take_sent();
  fd.command_joints(at_cycle(0));
  fd.run_for(1000, 100);
  fd.downstream.take_sent();
  auto frames = NodeBench::targets(at_cycle(1));
  for (CanFrame& frame : frames) {
    frame.flags = kFrameFd | kFrameBitRateSwitch;
    frame.len = 12;
    for (std::size_t k = 8; k < 12; ++k) frame.data[k] = static_cast<std::uint8_t>(0xA0 + k);
    fd.from_controller(frame);
  }
  const std::vector<CanFrame> out = fd.downstream.take_sent();
  ASSERT_EQ(out.size(), 3U);
  EXPECT_EQ(out[2].len, 12);
  EXPECT_EQ(out[2].flags, kFrameFd | kFrameBitRateSwitch);
  EXPECT_EQ(out[2].data[11], 0xAB);
}

TEST_F(InlineTest, OtherFrames_PassUnchangedInBothDirections) {
  std::vector<CanFrame> frames = {make_frame(0x601, {0x40, 1, 2, 3, 4, 5, 6, 7}),
                                  make_frame(0x80, {}), make_frame(0x181, {1, 2, 3}),
                                  make_frame(0x701, {5})};
  CanFrame extended = make_frame(0x18FF1234, {9, 8, 7});
  extended.flags = kFrameExtended;
  CanFrame remote = make_frame(0x301, {});
  remote.flags = kFrameRemote;
  remote.len = 4;
  CanFrame like_a_target = make_frame(0x220, {1, 2, 3, 4, 5, 6, 7, 8});
  like_a_target.flags = kFrameExtended;  // same number, another identifier
  frames.insert(frames.end(), {extended, remote, like_a_target});
  for (const CanFrame& frame : frames) {
    for (const bool down : {true, false}) {
      (down ? bench.upstream : bench.downstream).deliver(frame);
      bench.turn();
      const auto out = (down ? bench.downstream : bench.upstream).take_sent();
      ASSERT_EQ(out.size(), 1U) << std::hex << frame.id;
      EXPECT_EQ(out[0].id, frame.id);
      EXPECT_EQ(out[0].flags, frame.flags);
      EXPECT_EQ(out[0].len, frame.len);
      EXPECT_TRUE(std::equal(frame.data, frame.data + frame.len, out[0].data));
    }
  }
}

TEST_F(InlineTest, NotOperational_SendsNoTargets) {
  run(0, 10);
  bench.nmt(128);
  bench.downstream.take_sent();
  EXPECT_EQ(count_targets(cycle(11)), 0U);
  bench.start_nodes();
  bench.downstream.take_sent();
  cycle(12);
  EXPECT_EQ(count_targets(cycle(13)), 3U);
}

TEST_F(InlineTest, DownstreamBusOff_StopsOutputAndRecovers) {
  run(0, 10);
  bench.downstream.set_state(BusState::kBusOff);
  cycle(11);
  EXPECT_EQ(bench.node().joint_counters().output_refused, 3U);
  bench.run_for(150'000);
  EXPECT_EQ(bench.downstream.recoveries(), 1U);
  bench.downstream.take_sent();
  cycle(12);
  EXPECT_EQ(count_targets(cycle(13)), 3U) << "and nothing of what waited out the bus-off";
}

TEST_F(InlineTest, FullQueue_HoldsBackTheRestOfTheSet) {
  run(0, 10);
  bench.downstream.set_room(1 + 1);  // SYNC, one target
  EXPECT_EQ(count_targets(cycle(10)), 1U);
  EXPECT_EQ(bench.node().joint_counters().output_refused, 2U);
}

TEST_F(InlineTest, TargetsBySdo_AreForwardedAndReported) {
  bench.from_controller(make_frame(0x601, {0x23, 0x7A, 0x60, 0, 1, 2, 3, 4}));
  EXPECT_EQ(bench.downstream.take_sent().size(), 1U) << "passed on all the same";
  EXPECT_EQ(bench.read(0x2001, 11), 1U);
  EXPECT_EQ(bench.read(0x1003, 1) & 0xFFFFU, 0xFF13U);
  for (const std::uint32_t id : {0x600U, 0x680U}) {
    bench.from_controller(make_frame(id, {0x23, 0x7A, 0x60, 0, 1, 2, 3, 4}));
    EXPECT_EQ(bench.read(0x2001, 11), 1U) << "nobody's request";
  }
}

TEST_F(InlineTest, Disabling_FadesTheCorrectionWithoutAStep) {
  run(0, 100);
  Joints last = released(cycle(100));
  ASSERT_EQ(bench.write(0x2000, 2, 0, 1), 0U) << "allowed in motion";
  bench.downstream.take_sent();
  for (int k = 101; k < 300; ++k) {
    const Joints out = released(cycle(k));
    for (std::size_t j = 0; j < 6; ++j) {
      // 0.1 turn a second is 105 increments a cycle, beside the commanded motion itself.
      EXPECT_LE(std::abs(out[j] - last[j]), 106 + 20 * static_cast<int>(j + 1)) << k;
    }
    last = out;
  }
  EXPECT_EQ(last, at_cycle(299));
}

TEST_F(InlineTest, SynchronousTargets_LeaveJustBeforeTheSync) {
  for (int k = 0; k < 3; ++k) {
    const auto index = static_cast<std::uint16_t>(0x1400 + k);
    ASSERT_EQ(bench.write(index, 2, 1, 1), 0U);
  }
  bench.downstream.take_sent();
  bench.command_joints(at_cycle(0));
  EXPECT_EQ(bench.downstream.take_sent().size(), 0U);
  bench.sync();
  const std::vector<CanFrame> out = bench.downstream.take_sent();
  ASSERT_EQ(out.size(), 4U);
  EXPECT_EQ(out[3].id, 0x80U) << "the drives take the targets at this SYNC";
}

TEST_F(InlineTest, FirstSync_ReleasesNoOldSet) {
  bench.set_transmission(0x1400);
  bench.downstream.take_sent();
  bench.command_joints(at_cycle(0));
  bench.run_for(15'000);
  bench.sync();
  EXPECT_EQ(count_targets(bench.downstream.take_sent()), 0U)
      << "nobody knows how many SYNCs got lost";
  for (int k = 1; k < 4; ++k) {
    bench.command_joints(at_cycle(k));
    bench.next_sync();
    EXPECT_EQ(count_targets(bench.downstream.take_sent()), k == 1 ? 0U : 3U) << k;
  }
}

TEST(OffsetTest, Offsets_AreSentOncePerCompleteSetOnly) {
  NodeBench bench(false);
  bench.install(TestTable{}.image());
  bench.configure(Mode::kOffset);
  bench.upstream.take_sent();
  for (int k = 0; k < 50; ++k) {
    bench.next_sync();
    bench.command_joints(at_cycle(k));
    const std::vector<CanFrame> out = bench.upstream.take_sent();
    ASSERT_EQ(out.size(), k == 0 ? 0U : 3U);
    if (k == 0) continue;
    EXPECT_EQ(out[0].id, 0x1A0U);
    const auto offset = load_le<std::int32_t>(out[0].data);
    EXPECT_LT(std::abs(offset), 20000);
    if (k == 49) {
      EXPECT_NE(offset, 0);
    }
  }
  const auto frames = NodeBench::targets(at_cycle(50));
  bench.next_sync();
  bench.from_controller(frames[0]);
  bench.from_controller(frames[1]);
  EXPECT_TRUE(bench.upstream.take_sent().empty()) << "no set, no offset";
  bench.run_for(30'000);
  for (const CanFrame& frame : bench.upstream.take_sent()) EXPECT_EQ(frame.id, 0xA0U);
}

TEST(OffsetTest, FdFrames_CarryAllTargetsAndAllOffsets) {
  NodeBench bench(false, true);
  bench.install(TestTable{}.image());
  const auto map = [&](std::uint16_t base, std::uint32_t object) {
    ASSERT_EQ(bench.write(base, 0, 0, 1), 0U);
    for (std::uint32_t k = 0; k < 6; ++k) {
      ASSERT_EQ(
          bench.write(base, static_cast<std::uint8_t>(k + 1), (object + 0x800 * k) << 16 | 0x20, 4),
          0U);
    }
    ASSERT_EQ(bench.write(base, 0, 6, 1), 0U);
  };
  map(0x1600, 0x607A);
  map(0x1A00, 0x60B0);
  ASSERT_EQ(bench.write(0x1400, 1, 0x220, 4), 0U);
  ASSERT_EQ(bench.write(0x1800, 1, 0x400001A0, 4), 0U);
  ASSERT_EQ(bench.write(0x2000, 1, 2, 1), 0U);
  bench.start_nodes();
  bench.upstream.take_sent();
  std::int32_t last = 0;
  for (int cycle = 0; cycle < 30; ++cycle) {
    CanFrame frame;
    frame.id = 0x220;
    frame.flags = kFrameFd;
    frame.len = 24;
    for (std::size_t k = 0; k < 6; ++k) store_le(&frame.data[4 * k], at_cycle(cycle)[k]);
    bench.now_us += 1000;
    bench.from_controller(frame);
    const std::vector<CanFrame> out = bench.upstream.take_sent();
    ASSERT_EQ(out.size(), 1U);
    EXPECT_TRUE(out[0].is(kFrameFd));
    EXPECT_EQ(out[0].len, 24);
    last = load_le<std::int32_t>(&out[0].data[20]);
  }
  EXPECT_NE(last, 0);
}

TEST(JointPathTest, TargetsOfTooFewJoints_AreForwardedUncorrected) {
  NodeBench bench;
  ASSERT_EQ(bench.write(0x1400, 1, 0x220, 4), 0U);
  ASSERT_EQ(bench.write(0x2000, 1, 1, 1), 0U);
  bench.start_nodes();
  bench.downstream.take_sent();
  const CanFrame frame = NodeBench::pair_frame(0x220, 1, 2);
  bench.from_controller(frame);
  EXPECT_EQ(bench.downstream.take_sent().size(), 1U) << "passed on as any other frame";
  EXPECT_EQ(bench.read(0x2001, 2) & 1U, 0U) << "status: not configured";
}

// RPDO 4 maps axis 1, which RPDO 1 maps already.
class AxisMappedTwiceTest : public testing::Test {
 protected:
  AxisMappedTwiceTest() {
    bench.install(TestTable{}.image());
    bench.configure(Mode::kInline);
    EXPECT_EQ(bench.write(0x1603, 0, 0, 1), 0U);
    EXPECT_EQ(bench.write(0x1603, 1, 0x607A0020, 4), 0U);
    EXPECT_EQ(bench.write(0x1603, 0, 1, 1), 0U);
  }
  NodeBench bench;
};

TEST_F(AxisMappedTwiceTest, SecondRpdo_CannotBeSwitchedOn) {
  EXPECT_EQ(bench.write(0x1403, 1, 0x520, 4),
            static_cast<std::uint32_t>(Abort::kIncompatibleParameter));
  EXPECT_EQ(bench.read(0x2001, 2) & 1U, 1U) << "what there was stays";
  ASSERT_EQ(bench.write(0x1400, 1, 0x80000220, 4), 0U);
  EXPECT_EQ(bench.write(0x1403, 1, 0x520, 4), 0U) << "the other is off";
  EXPECT_EQ(bench.write(0x1400, 1, 0x220, 4),
            static_cast<std::uint32_t>(Abort::kIncompatibleParameter));
}

TEST_F(AxisMappedTwiceTest, AxisTwiceInOneRpdo_IsRefused) {
  ASSERT_EQ(bench.write(0x1400, 1, 0x80000220, 4), 0U);
  EXPECT_EQ(bench.write(0x1603, 0, 0, 1), 0U);
  EXPECT_EQ(bench.write(0x1603, 2, 0x607A0020, 4), 0U);
  EXPECT_EQ(bench.write(0x1603, 0, 2, 1), 0U);
  EXPECT_EQ(bench.write(0x1403, 1, 0x520, 4),
            static_cast<std::uint32_t>(Abort::kIncompatibleParameter));
}

TEST_F(AxisMappedTwiceTest, RpdosOffOrWithOtherObjects_AreAccepted) {
  EXPECT_EQ(bench.write(0x1403, 1, 0x80000520, 4), 0U);
  EXPECT_EQ(bench.write(0x140C, 1, 0x1D0, 4), 0U) << "no target";
  EXPECT_EQ(bench.write(0x1803, 1, 0x400004A0, 4), 0U) << "a TPDO of the same number";
}

}  // namespace
}  // namespace armtrue::canopen
