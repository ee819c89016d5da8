// A passive joint, turned by bars: its axis has no drive on the bus, and the node waits for none.
#include <gtest/gtest.h>

#include "firmware/testing/node_bench.h"
#include "firmware/testing/test_table.h"

namespace armtrue::canopen {
namespace {

constexpr std::uint8_t kAxisSix = 1U << 5;

// RPDO 3 and TPDO 3 of the bench carry axis 5 alone; axis 6 has no drive.
class PassiveAxisTest : public testing::Test {
 protected:
  void configure(Mode mode) {
    bench.configure(mode);
    bench.nmt(128);
    map_alone(0x1402, 0x1602, 0x420, 0x807A0020);
    map_alone(0x140A, 0x160A, 0x1C2, 0x80640020);
    if (mode == Mode::kOffset) map_alone(0x1802, 0x1A02, 0x400003A0U, 0x80B00020);
    bench.start_nodes();
  }
  void map_alone(std::uint16_t record, std::uint16_t mapping, std::uint32_t id,
                 std::uint32_t entry) {
    expect_done(record, 1, id | 0x80000000U, 4);
    expect_done(mapping, 0, 0, 1);
    expect_done(mapping, 1, entry, 4);
    expect_done(mapping, 0, 1, 1);
    expect_done(record, 1, id, 4);
  }
  void expect_done(std::uint16_t index, std::uint8_t sub, std::uint32_t value, int size) {
    EXPECT_EQ(bench.write(index, sub, value, size), 0U) << std::hex << index;
  }
  bool is_configured() { return (bench.read(0x2001, 2) & 1U) != 0; }
  std::uint32_t state() { return bench.read(0x2001, 1); }
  std::uint32_t reason() { return bench.read(0x2013, 2); }
  // Sends a set without axis 6. Returns the targets that left downstream; the last is axis 5's.
  std::vector<CanFrame> cycle(std::int32_t target) {
    bench.next_sync();
    auto frames = NodeBench::targets({target, target, target, target, target, 0});
    frames[2].len = 4;
    for (const CanFrame& frame : frames) bench.from_controller(frame);
    std::vector<CanFrame> sent = bench.downstream.take_sent();
    std::erase_if(sent, [](const CanFrame& f) { return f.id == 0x80 || f.id == 0x700; });
    return sent;
  }

  // Sends `cycles` sets. Returns the target that drive 1 was sent last.
  std::int32_t run(int cycles, std::int32_t target = 100'000) {
    std::int32_t last = INT32_MIN;
    for (int k = 0; k < cycles; ++k) {
      const std::vector<CanFrame> sent = cycle(target);
      if (!sent.empty()) last = load_le<std::int32_t>(&sent[0].data[0]);
    }
    return last;
  }
  void disable_and_fade() {
    ASSERT_EQ(bench.write(0x2000, 2, 0, 1), 0U);
    run(100);
    bench.run_for(1'100'000);
    ASSERT_EQ(state(), 0U);
  }
  void report_positions() {
    for (std::uint32_t pair = 0; pair < 2; ++pair)
      bench.from_drives(NodeBench::pair_frame(0x1C0 + pair, 100'000, 100'000));
  }

  TestTable with_drives;
  TestTable without_the_last{.sequence = 2, .passive = kAxisSix};
  NodeBench bench;
};

TEST_F(PassiveAxisTest, Inline_TargetsOfTheOtherAxesFormASet) {
  bench.install(without_the_last.image());
  configure(Mode::kInline);
  EXPECT_TRUE(is_configured());
  std::vector<CanFrame> sent;
  for (int k = 0; k < 100; ++k) sent = cycle(100'000);
  ASSERT_EQ(sent.size(), 3U);
  EXPECT_NE(load_le<std::int32_t>(&sent[0].data[0]), 100'000);
  EXPECT_EQ(sent[2].len, 4);
  EXPECT_NE(load_le<std::int32_t>(&sent[2].data[0]), 100'000);
}

TEST_F(PassiveAxisTest, Offset_BeginsOnceTheOtherDrivesHaveReported) {
  bench.install(without_the_last.image());
  configure(Mode::kOffset);
  EXPECT_TRUE(is_configured());
  for (int k = 0; k < 200; ++k) {
    for (std::uint32_t pair = 0; pair < 2; ++pair)
      bench.from_controller(NodeBench::pair_frame(0x1C0 + pair, 100'000, 100'000));
    CanFrame last = NodeBench::pair_frame(0x1C2, 100'000, 0);
    last.len = 4;
    bench.from_controller(last);
    cycle(100'000);
  }
  EXPECT_EQ(bench.read(0x2001, 2) & 0x10U, 0U) << "what the drives hold is known";
  EXPECT_NE(static_cast<std::int32_t>(bench.read(0x80B0, 0)), 0) << "axis 5";
  EXPECT_EQ(static_cast<std::int32_t>(bench.read(0x88B0, 0)), 0) << "axis 6";
}

TEST_F(PassiveAxisTest, TableWithDriveOnAxis6_NeedsItsTarget) {
  bench.install(with_drives.image());
  configure(Mode::kInline);
  EXPECT_FALSE(is_configured());
  bench.run_for(1'000'000);
  bench.install(without_the_last.image());
  EXPECT_TRUE(is_configured());
}

TEST_F(PassiveAxisTest, PassiveAxisTargetMapped_PassesUnchanged) {
  bench.install(without_the_last.image());
  bench.configure(Mode::kInline);
  std::vector<CanFrame> sent;
  for (int k = 0; k < 100; ++k) {
    bench.next_sync();
    bench.command_joints({100'000, 100'000, 100'000, 100'000, 100'000, 77'777});
    sent = bench.downstream.take_sent();
    std::erase_if(sent, [](const CanFrame& frame) { return frame.id != 0x420; });
  }
  ASSERT_EQ(sent.size(), 1U);
  EXPECT_NE(load_le<std::int32_t>(&sent[0].data[0]), 100'000);
  EXPECT_EQ(load_le<std::int32_t>(&sent[0].data[4]), 77'777);
}

// With a table that calls other joints passive, other targets form a set. The mapped ones would
// pass uncorrected from the next cycle on: a step by what the drives hold.
TEST_F(PassiveAxisTest, ActivateOfOtherPassiveJoints_WhileCorrecting_IsRefused) {
  bench.install(without_the_last.image());
  configure(Mode::kInline);
  const std::int32_t held = run(100);
  ASSERT_NE(held, 100'000);
  bench.run_for(600'000);
  with_drives.sequence = 3;
  bench.commit(with_drives.image());
  EXPECT_EQ(bench.command(TableCommand::kActivate), kDeviceState);
  EXPECT_EQ(reason(), 0x102U);
  EXPECT_EQ(bench.read(0x2013, 14), 0U) << "no trial";
  EXPECT_EQ(run(3), held);
  disable_and_fade();
  EXPECT_EQ(bench.command(TableCommand::kActivate), 0U);
  EXPECT_EQ(reason(), 0U);
  EXPECT_TRUE(is_configured()) << "the table before, until this one is enabled";
  EXPECT_EQ(bench.write(0x2000, 2, 1, 1), 0U);
  EXPECT_FALSE(is_configured());
}

TEST_F(PassiveAxisTest, ActivateOfTheSamePassiveJoints_WhileCorrecting_Blends) {
  bench.install(without_the_last.image());
  configure(Mode::kInline);
  const std::int32_t held = run(100);
  bench.run_for(600'000);
  without_the_last.sequence = 3;
  bench.put_on_trial(without_the_last.image());
  EXPECT_EQ(run(3), held);
  bench.run_for(600'000);
  EXPECT_EQ(bench.command(TableCommand::kRevert), 0U);
  EXPECT_EQ(run(3), held);
}

TEST_F(PassiveAxisTest, RevertToOtherPassiveJoints_WhileCorrecting_IsRefused) {
  bench.install(with_drives.image());
  configure(Mode::kInline);
  bench.put_on_trial(without_the_last.image());
  const std::int32_t held = run(100);
  ASSERT_NE(held, 100'000);
  bench.run_for(600'000);
  EXPECT_EQ(bench.command(TableCommand::kRevert), kDeviceState);
  EXPECT_EQ(reason(), 0x102U);
  EXPECT_EQ(bench.read(0x2013, 14), 1U) << "still on trial";
  EXPECT_EQ(run(3), held);
  disable_and_fade();
  EXPECT_EQ(bench.command(TableCommand::kRevert), 0U);
  EXPECT_EQ(bench.read(0x2013, 16), 1U);
}

TEST_F(PassiveAxisTest, EnablingOtherPassiveJoints_WhileADriveSends_IsRefused) {
  bench.install(without_the_last.image());
  configure(Mode::kInline);
  run(100);
  disable_and_fade();
  with_drives.sequence = 3;
  bench.install(with_drives.image());
  report_positions();
  EXPECT_EQ(bench.write(0x2000, 2, 1, 1), kDeviceState);
  EXPECT_EQ(reason(), 0x102U);
  EXPECT_TRUE(is_configured());
  bench.run_for(1'100'000);
  EXPECT_EQ(bench.write(0x2000, 2, 1, 1), 0U);
  EXPECT_EQ(reason(), 0U);
  EXPECT_FALSE(is_configured());
}

// After a restart the drives may hold a correction that the node does not know yet.
TEST_F(PassiveAxisTest, ActivateOfOtherPassiveJoints_WhileADriveSends_IsRefused) {
  bench.install(without_the_last.image());
  configure(Mode::kInline);
  with_drives.sequence = 3;
  bench.commit(with_drives.image());
  report_positions();
  EXPECT_EQ(bench.command(TableCommand::kActivate), kDeviceState);
  bench.run_for(1'100'000);
  EXPECT_EQ(bench.command(TableCommand::kActivate), 0U);
}

TEST_F(PassiveAxisTest, RefusedActivate_KeepsTheCommittedTable) {
  bench.install(without_the_last.image());
  configure(Mode::kInline);
  run(100);
  bench.run_for(600'000);
  with_drives.sequence = 3;
  bench.commit(with_drives.image());
  without_the_last.sequence = 4;
  ASSERT_EQ(bench.stage(without_the_last.image()), 0U);
  ASSERT_EQ(bench.command(TableCommand::kVerify), 0U);
  EXPECT_EQ(bench.command(TableCommand::kActivate), kDeviceState);
  EXPECT_EQ(bench.read(0x2013, 1), 0U) << "the slot was read into the staging buffer";
  disable_and_fade();
  EXPECT_EQ(bench.command(TableCommand::kActivate), 0U);
  EXPECT_EQ(bench.read(0x2013, 16), 3U);
}

// A table that is only staged says nothing about the drives of the table in force.
TEST_F(PassiveAxisTest, StagedTable_DoesNotLiftGuards) {
  bench.install(with_drives.image());
  bench.configure(Mode::kInline);
  bench.nmt(128);
  map_alone(0x140B, 0x160B, 0x1D0, 0x60410010);
  map_alone(0x140C, 0x160C, 0x1D5, 0x88410010);
  bench.start_nodes();
  for (int k = 0; k < 100; ++k) {
    bench.next_sync();
    bench.command_joints({100'000, 100'000, 100'000, 100'000, 100'000, 100'000});
  }
  for (const std::uint32_t id : {0x1D0U, 0x1D5U})
    bench.from_drives(make_frame(id, {kSwitchOnDisabled & 0xFF, kSwitchOnDisabled >> 8}));
  bench.run_for(600'000);
  ASSERT_EQ(bench.write(0x2000, 1, 0, 1), kDeviceState);
  ASSERT_EQ(bench.stage(TestTable{.sequence = 9, .passive = 0x1E}.image()), 0U);
  ASSERT_EQ(bench.command(TableCommand::kVerify), 0U);
  EXPECT_EQ(bench.write(0x2000, 1, 0, 1), kDeviceState);
  ASSERT_EQ(bench.command(TableCommand::kDiscard), 0U);
  EXPECT_EQ(bench.write(0x2000, 1, 0, 1), kDeviceState);
}

TEST_F(PassiveAxisTest, Start_DoesNotCorrectAMappedPassiveAxis) {
  bench.install(without_the_last.image());
  bench.configure(Mode::kInline);
  bench.nmt(128);
  map_alone(0x140A, 0x160A, 0x1C2, 0x80640020);
  bench.start_nodes();
  report_positions();
  CanFrame fifth = NodeBench::pair_frame(0x1C2, 100'000, 0);
  fifth.len = 4;
  bench.from_drives(fifth);
  for (int k = 0; k < 5; ++k) {
    bench.next_sync();
    bench.command_joints({100'000, 100'000, 100'000, 100'000, 100'000, 77'777});
    for (const CanFrame& frame : bench.downstream.take_sent()) {
      if (frame.id != 0x420) continue;
      EXPECT_EQ(load_le<std::int32_t>(&frame.data[4]), 77'777) << k;
    }
  }
}

// Frames to and from a passive axis say nothing about the state of a drive.
TEST_F(PassiveAxisTest, MappedPassiveAxis_DoesNotKeepOffsetsFromBeginning) {
  bench.install(without_the_last.image());
  bench.configure(Mode::kOffset);
  for (int k = 0; k < 300; ++k) {
    for (std::uint32_t pair = 0; pair < 2; ++pair)
      bench.from_controller(NodeBench::pair_frame(0x1C0 + pair, 100'000, 100'000));
    bench.from_controller(NodeBench::pair_frame(0x1C2, 100'000, 500'000 * (k % 2)));
    bench.next_sync();
    bench.command_joints({100'000, 100'000, 100'000, 100'000, 100'000, 77'777 + k});
  }
  EXPECT_EQ(bench.read(0x2001, 2) & 0x10U, 0U) << "what the drives hold is known";
  EXPECT_NE(static_cast<std::int32_t>(bench.read(0x60B0, 0)), 0);
  EXPECT_EQ(static_cast<std::int32_t>(bench.read(0x88B0, 0)), 0);
  EXPECT_EQ(bench.read(0x2005, 4), 0U) << "no jump of a position was seen";
}

TEST_F(PassiveAxisTest, StateOfAPassiveAxis_SuspendsNothing) {
  bench.install(without_the_last.image());
  configure(Mode::kInline);
  bench.nmt(128);
  map_alone(0x140B, 0x160B, 0x1D5, 0x88410010);
  bench.start_nodes();
  bench.from_drives(make_frame(0x1D5, {kSwitchOnDisabled & 0xFF, kSwitchOnDisabled >> 8}));
  EXPECT_NE(run(100), 100'000);
  EXPECT_EQ(bench.read(0x2005, 4), 0U);
  EXPECT_EQ(bench.read(0x2005, 2), 0U);
}

// The report says that there is a drive, though no joint of the arm needs it.
TEST_F(PassiveAxisTest, EnabledPassiveAxis_RefusesAnErase) {
  bench.install(without_the_last.image());
  map_alone(0x140B, 0x160B, 0x1D5, 0x88410010);
  bench.from_drives(make_frame(0x1D5, {kOperationEnabled & 0xFF, kOperationEnabled >> 8}));
  bench.run_for(1'001'000);
  EXPECT_EQ(bench.write(0x1010, 1, kSave, 4), kDeviceState);
  EXPECT_EQ(bench.read(0x2005, 2), 0U) << "it need not follow";
  bench.from_drives(make_frame(0x1D5, {kSwitchOnDisabled & 0xFF, kSwitchOnDisabled >> 8}));
  bench.run_for(1'001'000);
  EXPECT_EQ(bench.write(0x1010, 1, kSave, 4), 0U);
}

// First table: until it is verified, the node does not know that axis 6 has no drive to disable.
TEST_F(PassiveAxisTest, Commit_RequiresOnlyExistingDrivesDisabled) {
  for (std::uint16_t k = 0; k < 5; ++k) {
    const auto record = static_cast<std::uint16_t>(0x1408 + k);
    map_alone(record, static_cast<std::uint16_t>(0x1608 + k), 0x1D0U + k,
              (0x6041U + 0x800U * k) << 16 | 16);
  }
  const auto all_say = [this](int statusword) {
    for (std::uint32_t k = 0; k < 5; ++k)
      bench.from_drives(make_frame(0x1D0 + k, {statusword & 0xFF, statusword >> 8}));
  };
  EXPECT_EQ(bench.stage(without_the_last.image()), 0U);
  EXPECT_EQ(bench.command(TableCommand::kVerify), 0U);
  all_say(kOperationEnabled);
  EXPECT_EQ(bench.command(TableCommand::kCommit), kDeviceState);
  all_say(kSwitchOnDisabled);
  EXPECT_EQ(bench.command(TableCommand::kCommit), 0U);
}

}  // namespace
}  // namespace armtrue::canopen
