// States that drives report, and how the correction reacts, in inline and offset mode.
#include "firmware/canopen/motion/drive_states.h"

#include "firmware/testing/drives_bench.h"

namespace armtrue::canopen {
namespace {

// A turn has a million increments: at rest an actual position may move by 2000, a 500th of a turn.
class JumpTest : public testing::Test {
 protected:
  static constexpr std::uint32_t kPerTurn = 1'000'000;
  bool hear(std::int32_t actual, std::uint64_t now_us, bool at_rest = true,
            std::uint32_t per_turn = kPerTurn) {
    return states.hear_position(0, actual, at_rest, per_turn, PositionBounds{}, now_us);
  }
  DriveStates states;
};

TEST_F(JumpTest, ChangeAtRestBeyond500thOfATurn_IsAJump) {
  EXPECT_FALSE(hear(500'000, 0)) << "the first";
  EXPECT_FALSE(hear(502'000, 1'000));
  EXPECT_TRUE(hear(504'001, 2'000));
  EXPECT_FALSE(hear(504'001, 3'000));
  EXPECT_TRUE(hear(502'000, 4'000)) << "back";
}

TEST_F(JumpTest, ChangeAtRestAboveTwoTurnsPerSecond_IsAJump) {
  EXPECT_FALSE(hear(0, 0));
  EXPECT_FALSE(hear(100'000, 50'000));
  EXPECT_TRUE(hear(200'001, 100'000));
}

TEST_F(JumpTest, PositionsMoreThan100msApart_AreNotCompared) {
  EXPECT_FALSE(hear(0, 0));
  EXPECT_FALSE(hear(500'000, 100'001));
  EXPECT_TRUE(hear(0, 200'001));
}

TEST_F(JumpTest, InMotionOrWithoutScale_NoJumpIsReported) {
  EXPECT_FALSE(hear(0, 0));
  EXPECT_FALSE(hear(500'000, 1'000, false));
  EXPECT_FALSE(hear(0, 2'000, true, 0));
}

// In profile position mode an axis moves while its target is constant, at its own speed.
TEST_F(JumpTest, EnabledInAnotherMode_NoJumpIsReported) {
  struct Case {
    std::optional<std::uint16_t> statusword;
    std::int8_t mode;
    bool is_jump;
  };
  for (const Case& each :
       {Case{kOperationEnabled, 1, false}, Case{std::nullopt, 1, false}, Case{0x0217, 1, false},
        Case{kSwitchOnDisabled, 1, true}, Case{kOperationEnabled, 8, true},
        Case{kSwitchOnDisabled, 0, true}, Case{kSwitchOnDisabled, 6, false}}) {
    SCOPED_TRACE(each.mode);
    states = {};
    if (each.statusword) states.hear_state(0, *each.statusword);
    states.hear_mode(0, each.mode);
    EXPECT_FALSE(hear(0, 0));
    EXPECT_EQ(hear(500'000, 1'000), each.is_jump);
  }
}

TEST(DriveStates, Keep_ForgetsOnlyAxesThatAreNotMapped) {
  for (std::size_t mapped = 0; mapped < kMaxJoints; ++mapped) {
    DriveStates states;
    for (std::size_t axis = 0; axis < kMaxJoints; ++axis) {
      states.hear_state(axis, kOperationEnabled);
      states.hear_mode(axis, 8);
    }
    states.keep(1U << mapped, 0);
    EXPECT_EQ(states.known(), 1U << mapped);
    states.hear_state(mapped, kOperationEnabled);
    states.hear_mode(mapped, 8);
    states.keep(0, 1U << mapped);
    EXPECT_EQ(states.known(), 1U << mapped);
  }
}

TEST(DriveStates, AnAxisBeyondTheLast_IsIgnored) {
  DriveStates states;
  states.hear_state(kMaxJoints, kSwitchOnDisabled);
  states.hear_mode(kMaxJoints, 6);
  EXPECT_FALSE(states.hear_position(kMaxJoints, 1, true, 1'000'000, PositionBounds{}, 0));
  EXPECT_EQ(states.state(kMaxJoints), AxisState::kUnknown);
  EXPECT_EQ(states.known(), 0);
}

TEST(DriveStates, EachAxis_HasItsOwnBit) {
  DriveStates states;
  states.hear_state(0, kOperationEnabled);
  states.hear_state(7, kSwitchOnDisabled);
  states.hear_mode(3, 6);
  EXPECT_EQ(states.known(), 0x89);
  EXPECT_EQ(states.away(), 0x88);
  EXPECT_EQ(states.disabled(), 0x80);
}

// CiA 402-2, table 30. In quick stop active and fault reaction active the motor still has power.
TEST(DriveStates, Disabled_MeansMotorWithoutPower) {
  for (const int statusword : {0x0000, 0x0040, 0x0231, 0x0233, 0x0208, 0x0250, 0x0218}) {
    DriveStates states;
    states.hear_state(0, static_cast<std::uint16_t>(statusword));
    EXPECT_EQ(states.disabled(), 1) << std::hex << statusword;
    EXPECT_EQ(states.away(), 1) << std::hex << statusword;
  }
  for (const int statusword : {0x0217, 0x0207, 0x021F, 0x022F, 0x0237, 0x1237}) {
    DriveStates states;
    states.hear_state(0, static_cast<std::uint16_t>(statusword));
    EXPECT_EQ(states.disabled(), 0) << std::hex << statusword;
  }
}

constexpr std::int32_t kRate = 106;
constexpr int kFault = 0x0218;

// RPDO 13 receives the statusword and the mode of axis 1, RPDO 14 those of axis 2.
class DriveStatesTest : public DrivesTest {
 protected:
  DriveStatesTest() {
    for (std::uint16_t k = 0; k < 2; ++k) {
      const auto communication = static_cast<std::uint16_t>(0x140C + k);
      const auto mapping = static_cast<std::uint16_t>(0x160C + k);
      const std::uint32_t axis = 0x800U * k;
      EXPECT_EQ(bench.write(mapping, 0, 0, 1), 0U);
      EXPECT_EQ(bench.write(mapping, 1, (0x6041U + axis) << 16 | 0x10U, 4), 0U);
      EXPECT_EQ(bench.write(mapping, 2, (0x6061U + axis) << 16 | 0x08U, 4), 0U);
      EXPECT_EQ(bench.write(mapping, 0, 2, 1), 0U);
      EXPECT_EQ(bench.write(communication, 1, 0x1D0U + k, 4), 0U);
    }
    bench.run_for(600'000);
    take_output();
  }
  void drive_says(std::uint32_t axis, int statusword, int mode) {
    const CanFrame frame = make_frame(0x1D0 + axis, {statusword & 0xFF, statusword >> 8, mode});
    offset_ ? bench.from_controller(frame) : bench.from_drives(frame);
    take_output();
  }
  void all_follow() {
    drive_says(0, kOperationEnabled, 8);
    drive_says(1, kOperationEnabled, 8);
  }
  Joints correction() const {
    Joints result = {};
    for (std::size_t k = 0; k < 6; ++k) result[k] = stand[k] - target[k];
    return result;
  }
  // Cycles in which no drive, and no position that the controller sees, moves more than kRate.
  void rest_smoothly(int cycles) {
    for (int k = 0; k < cycles; ++k) {
      const Joints before = stand;
      const Joints saw = seen;
      cycle(kStand);
      ASSERT_LE(farthest(before, stand), kRate);
      ASSERT_LE(farthest(saw, seen), kRate);
    }
  }
  void expect_reason(std::uint32_t why) { EXPECT_EQ(bench.read(0x2005, 4), why); }
  void expect_suspended(std::uint32_t why) {
    EXPECT_EQ(bench.read(0x2005, 3), static_cast<std::uint32_t>(Phase::kSuspended));
    expect_reason(why);
  }
};

TEST_P(DriveStatesTest, Correction_IsSuspendedUntilAllDrivesFollow) {
  settle();
  all_follow();
  const Joints before = correction();
  struct Away {
    int statusword;
    int mode;
  };
  for (const Away away : {Away{kSwitchOnDisabled, 8}, Away{kFault, 8}, Away{kOperationEnabled, 6},
                          Away{kOperationEnabled, 4}, Away{kOperationEnabled, 7}}) {
    SCOPED_TRACE(away.statusword * 16 + away.mode);
    drive_says(0, away.statusword, away.mode);
    rest_smoothly(100);
    EXPECT_EQ(correction(), Joints{});
    EXPECT_EQ(seen, kStand);
    expect_suspended(1);
    EXPECT_EQ(bench.read(0x2005, 2), 1U) << "which";
    drive_says(1, kSwitchOnDisabled, 8);
    drive_says(0, kOperationEnabled, 8);
    rest_smoothly(50);
    EXPECT_EQ(correction(), Joints{}) << "not all have returned";
    drive_says(1, kOperationEnabled, 8);
    rest_smoothly(200);
    EXPECT_EQ(correction(), before);
    EXPECT_EQ(seen, kStand);
  }
  EXPECT_EQ(bench.read(0x2005, 5), 5U);
  EXPECT_EQ(bench.read(0x2005, 6), 5U);
}

// An event occurs while a set waits for its SYNC, which is late: that set is dropped.
class WaitingSetTest : public DriveStatesTest {
 protected:
  WaitingSetTest() {
    bench.set_transmission(0x1400);
    settle();
    all_follow();
    rest(kStand, 20);
    whole_ = correction();
  }
  void let_a_set_wait() {
    rest(kStand, 20);
    bench.next_sync();
    bench.command_joints(kStand);
    take_output();
  }
  void end_late() {
    bench.now_us += 2'500;
    bench.turn();
    bench.sync();
    take_output();
    ASSERT_EQ(outputs, 0);
  }
  // 200 ms with neither SYNC nor targets, then both again.
  void expect_zero_in_silence_and_in_a_stream() {
    EXPECT_LE(wait(200), offset_ ? kRate : 0);
    if (offset_) {
      EXPECT_EQ(correction(), Joints{});
      EXPECT_EQ(bench.read(0x2001, 1), 0U);
    }
    rest(kStand, 200);
    EXPECT_EQ(correction(), Joints{});
    EXPECT_EQ(bench.read(0x2001, 1), 0U);
  }
  Joints whole_ = {};
};

TEST_P(WaitingSetTest, Disabling_CorrectionGoesToZero) {
  let_a_set_wait();
  ASSERT_EQ(bench.write(0x2000, 2, 0, 1), 0U);
  expect_zero_in_silence_and_in_a_stream();
}

TEST_P(WaitingSetTest, DriveFault_CorrectionGoesToZero) {
  let_a_set_wait();
  drive_says(0, kFault, 8);
  expect_zero_in_silence_and_in_a_stream();
  expect_suspended(1);
}

TEST_P(WaitingSetTest, EncoderZeroChanges_CorrectionGoesToZero) {
  rest(kStand, 150);
  let_a_set_wait();
  stand[2] += 5000;
  feed_back();
  stand[2] -= 5000;
  expect_zero_in_silence_and_in_a_stream();
  expect_suspended(2);
}

TEST_P(WaitingSetTest, DriveFollowsAgain_CorrectionReturns) {
  drive_says(0, kFault, 8);
  rest(kStand, 150);
  ASSERT_EQ(correction(), Joints{});
  let_a_set_wait();
  drive_says(0, kOperationEnabled, 8);
  end_late();
  rest(kStand, 200);
  EXPECT_EQ(correction(), whole_);
  EXPECT_EQ(bench.read(0x2001, 1), 2U);
}

TEST_P(WaitingSetTest, NmtStop_NextStartRestoresTheCorrection) {
  let_a_set_wait();
  drive_says(0, kFault, 8);
  wait(200);
  nmt(2);
  wait(100);
  if (offset_) {
    EXPECT_EQ(correction(), Joints{});
  }
  EXPECT_EQ(state(), NmtState::kStopped);
  bench.start_nodes();
  drive_says(0, kOperationEnabled, 8);
  rest(kStand, 400);
  EXPECT_EQ(correction(), whole_);
}

INSTANTIATE_TEST_SUITE_P(Modes, WaitingSetTest, ::testing::Values(Mode::kInline, Mode::kOffset),
                         mode_name);

TEST_P(DriveStatesTest, SuspensionWithoutTargets_MakesNoStepThenOrLater) {
  settle();
  all_follow();
  bench.run_for(100'000);
  take_output();
  drive_says(0, kSwitchOnDisabled, 8);
  Joints saw = seen;
  for (int k = 0; k < 100; ++k) {
    bench.now_us += 1000;
    bench.turn();
    take_output();
    feed_back();
    ASSERT_LE(farthest(saw, seen), offset_ ? 2 * kRate : kRate);
    saw = seen;
  }
  expect_suspended(1);
  EXPECT_EQ(seen[0], stand[0]) << "nothing is taken off a position that nothing was put on";
  if (offset_) return;
  EXPECT_EQ(seen[1], kStand[1]) << "a drive that follows holds what it was given";
  target = stand = Joints{seen[0], stand[1], stand[2], stand[3], stand[4], stand[5]};
  for (int k = 0; k < 100; ++k) {
    const Joints before = stand;
    cycle({seen[0], kStand[1], kStand[2], kStand[3], kStand[4], kStand[5]});
    ASSERT_LE(farthest(before, stand), kRate);
  }
  EXPECT_EQ(correction(), Joints{});
}

TEST_P(DriveStatesTest, SilentDrives_CountAsFollowing) {
  settle();
  EXPECT_EQ(bench.read(0x2005, 1), 0U) << "and that is said";
  EXPECT_EQ(bench.read(0x2005, 3), static_cast<std::uint32_t>(Phase::kCorrecting));
  drive_says(1, kOperationEnabled, 8);
  EXPECT_EQ(bench.read(0x2005, 1), 2U);
}

TEST_P(DriveStatesTest, EncoderZeroChangeAtRest_SuspendsUntilReenabled) {
  settle();
  all_follow();
  rest(kStand, 150);
  stand[2] += 5000;
  feed_back();
  const Joints jumped = stand;
  for (int k = 0; k < 100; ++k) {
    const Joints before = stand;
    cycle(kStand);
    ASSERT_LE(farthest(before, stand), k == 0 ? 6000 : kRate);
  }
  EXPECT_NE(jumped, stand);
  expect_suspended(2);
  EXPECT_EQ(bench.read(0x2005, 7), 2U) << "there, and back";
  EXPECT_EQ(bench.read(0x1003, 1), 0x0003FF16U) << "of axis 3";
  ASSERT_EQ(bench.write(0x2000, 2, 0, 1), 0U);
  bench.run_for(600'000);
  take_output();
  ASSERT_EQ(bench.write(0x2000, 2, 1, 1), 0U);
  rest_smoothly(200);
  EXPECT_GT(farthest(stand, kStand), 150) << "confirmed by disabling and enabling";
}

TEST_P(DriveStatesTest, EncoderZeroChange_IsReportedAgainAfterResetCommunication) {
  ASSERT_EQ(bench.write(0x1010, 1, kSave, 4), 0U);
  settle();
  rest(kStand, 150);
  stand[2] += 5000;
  feed_back();
  bench.run_for(1000);
  nmt(130);
  wait(6'000);
  EXPECT_EQ(bench.read(0x1003, 1), 0x0003FF16U);
  EXPECT_NE(bench.read(0x1001, 0), 0U);
  expect_reason(2);
  ASSERT_EQ(bench.write(0x2000, 2, 0, 1), 0U);
  bench.run_for(1000);
  EXPECT_EQ(bench.read(0x1001, 0), 0U);
}

TEST_P(DriveStatesTest, EncoderZeroChangeByHoming_IsNotCounted) {
  settle();
  all_follow();
  drive_says(0, kOperationEnabled, 6);
  rest(kStand, 150);
  stand[0] += 5000;
  feed_back();
  EXPECT_EQ(bench.read(0x2005, 7), 0U);
}

INSTANTIATE_TEST_SUITE_P(Modes, DriveStatesTest, ::testing::Values(Mode::kInline, Mode::kOffset),
                         mode_name);

class OffsetReadBackTest : public DriveStatesTest {};

TEST_P(OffsetReadBackTest, OffsetReadBackNotAsSent_IsReported) {
  map_offset_of_joint_1();
  settle();
  for (int k = 0; k < 50; ++k) drive_has(held[0]);
  EXPECT_EQ(bench.read(0x1001, 0), 0U);
  for (int k = 0; k < 50; ++k) drive_has(-held[0]);
  EXPECT_EQ(bench.read(0x1003, 1), 0x0001FF17U) << "of axis 1";
  drive_has(held[0]);
  EXPECT_EQ(bench.read(0x1001, 0), 0U);
}

INSTANTIATE_TEST_SUITE_P(Offset, OffsetReadBackTest, ::testing::Values(Mode::kOffset));

}  // namespace
}  // namespace armtrue::canopen
