// Guarantees that hold for every table: pass-through, limits, blending, switching, continuity.
#include "firmware/core/compensator.h"

#include <gtest/gtest.h>

#include <cmath>
#include <deque>
#include <random>

#include "firmware/core/table/test_image.h"

namespace armtrue {
namespace {

using tests::Bytes;
using tests::kIncrementsPerRadian;
using tests::kJoints;
using tests::TestImage;

std::int32_t increments(double radian) {
  return static_cast<std::int32_t>(std::llround(radian * kIncrementsPerRadian));
}

CompensatorConfig config() { return {.joint_count = kJoints}; }

CycleInput at(double a, double b = 0.4, double c = -0.3) {
  CycleInput input;
  input.target = {increments(a), increments(b), increments(c)};
  return input;
}

// Runs cycles at one target until the blend is over.
CycleOutput settle(Compensator& compensator, const CycleInput& input, int cycles = 400) {
  CycleOutput output;
  for (int i = 0; i < cycles; ++i) output = compensator.cycle(input);
  return output;
}

void put_in_force(Compensator& compensator, const Bytes& image) {
  ASSERT_TRUE(compensator.load(image, {}).accepted());
  ASSERT_TRUE(compensator.activate());
}

Bytes offset_table(double radian) {
  TestImage made(kJoints);
  for (std::uint8_t k = 0; k < kJoints; ++k) made.add_constant(k, radian);
  return made.image();
}

class CompensatorTest : public ::testing::Test {
 protected:
  // Activates a copy of `image`, which is kept until the test ends.
  void activate(const Bytes& image) {
    images_.push_back(image);
    put_in_force(compensator, images_.back());
  }

  Compensator compensator{config()};

 private:
  std::deque<Bytes> images_;
};

TEST_F(CompensatorTest, WithoutATableTheOutputIsTheInput) {
  const CycleCounters& counted = compensator.counters();
  EXPECT_EQ(counted.cycles, 0U);
  std::mt19937 random(1);
  for (int i = 0; i < 10000; ++i) {
    CycleInput input;
    for (std::int32_t& target : input.target) target = static_cast<std::int32_t>(random());
    input.temperature_valid = static_cast<std::uint32_t>(random());
    input.payload_g = static_cast<std::int32_t>(random());
    const CycleOutput output = compensator.cycle(input);
    for (std::size_t k = 0; k < kJoints; ++k) {
      ASSERT_EQ(output.corrected[k], input.target[k]);
      ASSERT_EQ(output.delta[k], 0);
    }
    ASSERT_EQ(output.state, CompensatorState::kPassThrough);
    ASSERT_EQ(output.flags, kCycleClean);
    ASSERT_EQ(output.cycle, static_cast<std::uint32_t>(i));
  }
  EXPECT_EQ(counted.cycles, 10000U);
  for (const std::uint32_t other :
       {counted.magnitude_clamped, counted.rate_clamped, counted.output_saturated}) {
    EXPECT_EQ(other, 0U);
  }
}

TEST_F(CompensatorTest, ARefusedTableChangesNothing) {
  Bytes image = offset_table(1e-3);
  image[200] ^= 1U;
  EXPECT_EQ(compensator.load(image, {}).refusal, Refusal::kChecksum);
  EXPECT_FALSE(compensator.activate());
  EXPECT_EQ(settle(compensator, at(0.1)).delta[0], 0);
  Bytes six_joints = TestImage(6).image();
  EXPECT_EQ(compensator.load(six_joints, {}).refusal, Refusal::kJointCount);
}

TEST_F(CompensatorTest, MotorOffsets_AreSubtractedWithinOneIncrement) {
  activate(offset_table(1e-3));
  for (const double q : {-3.0, -0.2, 0.0, 1.5, 3.1}) {
    const CycleOutput output = settle(compensator, at(q));
    EXPECT_EQ(output.state, CompensatorState::kActive);
    for (std::size_t k = 0; k < kJoints; ++k) EXPECT_NEAR(output.delta[k], -increments(1e-3), 1);
  }
}

TEST_F(CompensatorTest, LinkTermsGoThroughTheJacobian) {
  // The first link is 1 mm too long: the tool must still reach the nominal point.
  TestImage made(kJoints);
  made.add_constant(8 + 6, 1e-3);
  activate(made.image());
  const double q[3] = {0.3, 0.9, -0.7};
  const CycleOutput output = settle(compensator, at(q[0], q[1], q[2]));
  const auto tool = [](double a, double b, double c, double longer) {
    return std::array<double, 2>{
        (0.5 + longer) * std::cos(a) + 0.5 * std::cos(a + b) + 0.5 * std::cos(a + b + c),
        (0.5 + longer) * std::sin(a) + 0.5 * std::sin(a + b) + 0.5 * std::sin(a + b + c)};
  };
  const auto wanted = tool(q[0], q[1], q[2], 0.0);
  const auto reached =
      tool(output.corrected[0] / kIncrementsPerRadian, output.corrected[1] / kIncrementsPerRadian,
           output.corrected[2] / kIncrementsPerRadian, 1e-3);
  // One increment is 0.4 µrad, up to 0.5 µm at this tool.
  EXPECT_NEAR(reached[0], wanted[0], 1e-6);
  EXPECT_NEAR(reached[1], wanted[1], 1e-6);
}

TEST_F(CompensatorTest, EnablingDisablingAndSwitchingMakeNoStep) {
  const Bytes first = offset_table(5e-3);
  const Bytes second = offset_table(-5e-3);
  std::array<std::int32_t, kMaxJoints> last = {};
  double largest_step = 0.0;
  const auto run = [&](int cycles) {
    CycleOutput output;
    for (int i = 0; i < cycles; ++i) {
      output = compensator.cycle(at(0.2));
      for (std::size_t k = 0; k < kJoints; ++k) {
        largest_step =
            std::max(largest_step, std::abs(static_cast<double>(output.delta[k]) - last[k]));
      }
      last = output.delta;
    }
    return output;
  };
  run(5);
  put_in_force(compensator, first);
  EXPECT_NEAR(run(150).delta[0], -increments(5e-3), 1);
  put_in_force(compensator, second);
  EXPECT_EQ(compensator.state(), CompensatorState::kBlending);
  EXPECT_NEAR(run(150).delta[0], increments(5e-3), 1);
  compensator.disable();
  const CycleOutput off = run(150);
  EXPECT_EQ(off.state, CompensatorState::kPassThrough);
  EXPECT_EQ(off.corrected[0], at(0.2).target[0]);
  // 100 ms in cycles of 1 ms: the largest change, 10 mrad, takes 101 cycles.
  EXPECT_LE(largest_step, increments(10e-3) / 100.0 + 1.0);
  EXPECT_EQ(compensator.counters().rate_clamped, 0U);
}

TEST_F(CompensatorTest, DisableDuringBlend_FadesFromCurrentCorrection) {
  activate(offset_table(5e-3));
  const CycleOutput half = settle(compensator, at(0.2), 50);
  ASSERT_NEAR(half.delta[0], -increments(2.5e-3), 1000);
  compensator.disable();
  const CycleOutput next = compensator.cycle(at(0.2));
  EXPECT_NEAR(next.delta[0], half.delta[0], increments(5e-3) / 50);
  EXPECT_EQ(settle(compensator, at(0.2)).delta[0], 0);
}

TEST_F(CompensatorTest, DisablingWithoutATableIsPassThrough) {
  compensator.disable();
  const CycleOutput output = compensator.cycle(at(0.2));
  EXPECT_EQ(output.state, CompensatorState::kPassThrough);
  EXPECT_EQ(output.corrected[0], at(0.2).target[0]);
  activate(offset_table(1e-3));
  EXPECT_NEAR(settle(compensator, at(0.2)).delta[0], -increments(1e-3), 1);
}

TEST_F(CompensatorTest, IsInUse_IsTrueForPendingAndActiveTables) {
  const Bytes first = offset_table(1e-3);
  const Bytes second = offset_table(2e-3);
  EXPECT_FALSE(compensator.is_in_use(first));
  put_in_force(compensator, first);
  EXPECT_TRUE(compensator.is_in_use(first));
  ASSERT_TRUE(compensator.load(second, {}).accepted());
  EXPECT_TRUE(compensator.is_in_use(second)) << "it waits";
  EXPECT_TRUE(compensator.is_in_use(first));
  ASSERT_TRUE(compensator.activate());
  EXPECT_FALSE(compensator.is_in_use(first)) << "the way to another reads only that";
  compensator.disable();
  EXPECT_FALSE(compensator.is_in_use(second)) << "nor is an image read on the way to zero";
}

TEST_F(CompensatorTest, FadeToZero_ReadsNoImage) {
  Bytes image = offset_table(5e-3);
  put_in_force(compensator, image);
  CycleOutput last = settle(compensator, at(0.2));
  compensator.disable();
  std::fill(image.begin(), image.end(), std::uint8_t{0xA5});
  const double permitted = 16777216.0 * 0.1 / 1000.0;
  for (int cycle = 0; cycle < 400; ++cycle) {
    const CycleOutput next = compensator.cycle(at(0.2));
    ASSERT_LE(std::abs(next.delta[0] - last.delta[0]), permitted + 2) << cycle;
    last = next;
  }
  EXPECT_EQ(last.delta[0], 0);
}

TEST_F(CompensatorTest, EarlyCycles_KeepTheRateLimitPerSecond) {
  TestImage made(kJoints);
  made.add_constant(0, 0.2);
  activate(made.image());
  CycleInput input = at(0.2);
  input.elapsed_us = 70;
  const std::int32_t before = compensator.cycle(input).delta[0];
  std::int32_t after = before;
  for (int set = 0; set < 1000; ++set) after = compensator.cycle(input).delta[0];
  // 0.1 turn per second for 70 ms, and one increment per cycle for rounding up.
  EXPECT_LE(std::abs(after - before), 16777216.0 * 0.1 * 0.070 + 1000);
}

TEST_F(CompensatorTest, FadeToZero_AtAnyAcceptedRate_EndsInTime) {
  for (const std::int32_t rate : {4 * kMinRate, kMinRate, kMinRate - 1, 999, 0}) {
    const Bytes fast = offset_table(5e-3);
    TestImage slow(kJoints);
    for (std::size_t k = 0; k < kJoints; ++k) {
      tests::put(slow.section(format::Section::kJoints),
                 k * format::joint::kLength + format::joint::kRateAt, rate);
    }
    const Bytes image = slow.image();
    Compensator own(config());
    put_in_force(own, fast);
    settle(own, at(0.2));
    const bool accepted = own.load(image, {}).accepted();
    ASSERT_EQ(accepted, rate >= kMinRate);
    if (!accepted) continue;  // refused, so there is no fade to check
    ASSERT_TRUE(own.activate());
    own.cycle(at(0.2));
    own.park();
    EXPECT_TRUE(own.is_fading());
    settle(own, at(0.2), Compensator::kFadeCycles);
    EXPECT_FALSE(own.is_fading()) << rate;
  }
}

TEST_F(CompensatorTest, TakeBack_DoesNotAffectLaterOutputs) {
  const Bytes image = offset_table(5e-3);
  Compensator once(config());
  Compensator twice(config());
  put_in_force(once, image);
  put_in_force(twice, image);
  for (int cycle = 0; cycle < 100; ++cycle) {
    const CycleInput input = at(0.2 + 1e-3 * cycle);
    twice.cycle(at(-1.0));
    twice.take_back();
    ASSERT_EQ(once.cycle(input).corrected, twice.cycle(input).corrected) << cycle;
  }
}

// Requests to the compensator between a cycle and its take_back().
class TakenBackTest : public CompensatorTest {
 protected:
  TakenBackTest() {
    activate(offset_table(5e-3));
    whole_ = settle(compensator, at(0.2)).delta[0];
  }
  // Runs a cycle, applies `change`, takes the cycle back. Returns the correction kFadeCycles later,
  // when every blend has ended.
  template <typename Change>
  std::int32_t after(const Change& change) {
    compensator.cycle(at(0.2));
    change();
    compensator.take_back();
    return settle(compensator, at(0.2), Compensator::kFadeCycles).delta[0];
  }
  std::int32_t whole_ = 0;
};

TEST_F(TakenBackTest, DisableBeforeTakeBack_FadesToZero) {
  EXPECT_EQ(after([this] { compensator.disable(); }), 0);
  EXPECT_EQ(compensator.state(), CompensatorState::kPassThrough);
}

TEST_F(TakenBackTest, ParkBeforeTakeBack_FadesToZero) {
  EXPECT_EQ(after([this] { compensator.park(); }), 0);
  EXPECT_EQ(compensator.state(), CompensatorState::kPassThrough);
}

TEST_F(TakenBackTest, ParkOrDisable_FadesBeforeAndAfterTakeBack) {
  for (const bool parked : {true, false}) {
    settle(compensator, at(0.2));
    parked ? compensator.park() : compensator.disable();
    EXPECT_TRUE(compensator.is_fading());
    compensator.take_back();
    EXPECT_TRUE(compensator.is_fading()) << parked;
    compensator.resume();
  }
}

TEST_F(TakenBackTest, ResumeBeforeTakeBack_BlendsInAgain) {
  compensator.park();
  settle(compensator, at(0.2));
  EXPECT_EQ(after([this] { compensator.resume(); }), whole_);
}

TEST_F(TakenBackTest, NewTableBeforeTakeBack_BlendsIn) {
  EXPECT_EQ(after([this] { activate(offset_table(2e-3)); }), -increments(2e-3));
}

TEST_F(TakenBackTest, DisableAndTakeBackOfLastFadeCycle_FadesOn) {
  compensator.park();
  std::int32_t last = 0;
  while (compensator.state() != CompensatorState::kPassThrough) {
    last = compensator.correction_of(compensator.counters().cycles - 1, 0);
    compensator.cycle(at(0.2));
  }
  ASSERT_NE(last, 0);
  compensator.disable();
  compensator.take_back();
  EXPECT_TRUE(compensator.is_fading());
  EXPECT_EQ(settle(compensator, at(0.2)).delta[0], 0);
  EXPECT_EQ(compensator.state(), CompensatorState::kPassThrough);
}

TEST_F(CompensatorTest, TakeBackOfOneJoint_KeepsItsCorrection) {
  TestImage made(kJoints);
  made.add_constant(0, 5e-3);
  made.add_constant(1, 5e-3);
  activate(made.image());
  CycleOutput output;
  for (int k = 0; k < 20; ++k) output = compensator.cycle(at(0.2));
  const std::int32_t held = output.delta[0];
  ASSERT_NE(held, 0);
  std::int32_t last = output.delta[1];
  for (int k = 0; k < 300; ++k) {
    output = compensator.cycle(at(0.2));
    EXPECT_LE(std::abs(output.delta[1] - last), increments(5e-3) / 50);
    last = output.delta[1];
    compensator.take_back_of(1);
    ASSERT_EQ(compensator.correction_of(output.cycle, 0), held) << "what is taken off again";
    ASSERT_EQ(compensator.correction_of(output.cycle, 1), last);
  }
  EXPECT_NEAR(last, -increments(5e-3), 1) << "the others go on";
  EXPECT_EQ(settle(compensator, at(0.2)).delta[0], last);
}

TEST_F(CompensatorTest, TakeBackOfOneJoint_AfterBegin_KeepsHeldCorrection) {
  activate(offset_table(5e-3));
  std::array<std::int32_t, kJoints> held = {};
  held[0] = 1000;
  EXPECT_TRUE(compensator.begin(held));
  const CycleOutput output = compensator.cycle(at(0.2));
  ASSERT_NE(output.delta[0], 1000);
  compensator.take_back_of(1);
  EXPECT_EQ(compensator.correction_of(output.cycle, 0), 1000);
}

TEST_F(CompensatorTest, TakeBackOfFinalZero_AtOneJoint_FadesOn) {
  TestImage made(kJoints);
  made.add_constant(0, 5e-3);
  activate(made.image());
  settle(compensator, at(0.2));
  compensator.park();
  while (compensator.is_fading()) compensator.cycle(at(0.2));
  compensator.take_back_of(2);
  EXPECT_FALSE(compensator.is_fading()) << "a joint that held nothing";
  compensator.take_back_of(1);
  EXPECT_TRUE(compensator.is_fading());
  EXPECT_EQ(compensator.cycle(at(0.2)).delta[0], 0);
  EXPECT_EQ(compensator.state(), CompensatorState::kPassThrough);
}

TEST_F(CompensatorTest, TakeBackOfCycles_ContinuesFromTheOneBefore) {
  activate(offset_table(5e-3));
  CycleOutput output;
  std::array<std::array<std::int32_t, kJoints>, 20> delta = {};
  for (auto& row : delta) {
    output = compensator.cycle(at(0.2));
    std::copy_n(output.delta.begin(), kJoints, row.begin());
  }
  ASSERT_NE(delta[18][0], delta[15][0]);
  compensator.take_back_cycles(0, 4);
  for (std::uint32_t age = 0; age < 5; ++age) {
    EXPECT_EQ(compensator.correction_of(output.cycle - age, 0), delta[15][0]) << age;
    EXPECT_EQ(compensator.correction_of(output.cycle - age, 1), delta[19 - age][1]);
  }
  const std::int32_t usual = std::abs(delta[16][0] - delta[15][0]);
  const CycleOutput next = compensator.cycle(at(0.2));
  EXPECT_LE(std::abs(next.delta[0] - delta[15][0]), increments(5e-3) / 20 + usual);
  compensator.take_back_cycles(0, 200);
  EXPECT_EQ(
      compensator.correction_of(next.cycle, 0),
      compensator.correction_of(static_cast<std::uint32_t>(next.cycle - kFeedbackHistory + 1), 0))
      << "the oldest that is known";
  EXPECT_EQ(settle(compensator, at(0.2)).delta[0], -increments(5e-3));
}

TEST_F(CompensatorTest, TakeBackOfFinalZeroes_FadesOn) {
  activate(offset_table(5e-3));
  settle(compensator, at(0.2));
  compensator.park();
  while (compensator.is_fading()) compensator.cycle(at(0.2));
  compensator.take_back_cycles(0, 3);
  EXPECT_TRUE(compensator.is_fading());
  EXPECT_EQ(settle(compensator, at(0.2)).delta[0], 0);
  EXPECT_EQ(compensator.state(), CompensatorState::kPassThrough);
}

TEST_F(CompensatorTest, BeginWhileDisabled_BlendsHeldCorrectionOut) {
  activate(offset_table(5e-3));
  compensator.disable();
  std::array<std::int32_t, kJoints> held = {};
  held[0] = -increments(4e-3);
  EXPECT_TRUE(compensator.begin(held));
  std::int32_t last = held[0];
  for (int k = 0; k < 200; ++k) {
    const CycleOutput output = compensator.cycle(at(0.2));
    ASSERT_LE(std::abs(output.delta[0] - last), increments(4e-3) / 20) << k;
    last = output.delta[0];
  }
  EXPECT_EQ(last, 0);
  EXPECT_EQ(compensator.state(), CompensatorState::kPassThrough);
}

TEST_F(CompensatorTest, BeginWhileDisabled_NothingHeld_IsPassThrough) {
  activate(offset_table(5e-3));
  compensator.disable();
  EXPECT_TRUE(compensator.begin(std::array<std::int32_t, kJoints>{}));
  EXPECT_EQ(compensator.state(), CompensatorState::kPassThrough);
}

TEST_F(CompensatorTest, ParkAndResume_BlendWithoutAStep) {
  activate(offset_table(5e-3));
  CycleOutput last = settle(compensator, at(0.2));
  const std::int32_t whole = last.delta[0];
  const auto run = [&](int cycles) {
    for (int cycle = 0; cycle < cycles; ++cycle) {
      const CycleOutput next = compensator.cycle(at(0.2));
      ASSERT_LE(std::abs(next.delta[0] - last.delta[0]), 16777216.0 * 0.1 / 1000.0 + 2);
      last = next;
    }
  };
  compensator.park();
  run(300);
  EXPECT_EQ(last.delta[0], 0);
  compensator.resume();
  run(300);
  EXPECT_EQ(last.delta[0], whole);
}

class FinerDrivesTest : public ::testing::TestWithParam<double> {};

TEST_P(FinerDrivesTest, TableSwitch_KeepsRateLimit_CountsClampedJoint) {
  const auto with_offset_of_joint_2 = [](std::uint8_t finer) {
    TestImage made(kJoints);
    made.add_constant(1, GetParam());
    for (std::size_t k = 0; k < kJoints; ++k) {
      Bytes& joints = made.section(format::Section::kJoints);
      const std::size_t at = k * format::joint::kLength;
      joints[at + format::joint::kUnitShiftAt] = static_cast<std::uint8_t>(22 + finer);
      joints[at + format::joint::kIncrementShiftAt] = static_cast<std::uint8_t>(38 - finer);
    }
    return made.image();
  };
  const Bytes coarse = with_offset_of_joint_2(0);
  const Bytes fine = with_offset_of_joint_2(4);
  Compensator compensator(config());
  put_in_force(compensator, coarse);
  std::int32_t last = settle(compensator, at(0.0, 0.0, 0.0)).delta[1];
  ASSERT_EQ(compensator.counters().clamped[1], 0U);
  put_in_force(compensator, fine);
  for (int cycle = 0; cycle < 100; ++cycle) {
    const std::int32_t next = compensator.cycle(at(0.0, 0.0, 0.0)).delta[1];
    ASSERT_LE(std::abs(next - last), 16 * 16777216.0 * 0.1 / 1000.0 + 2);
    last = next;
  }
  EXPECT_GT(compensator.counters().clamped[1], 0U);
  EXPECT_EQ(compensator.counters().clamped[0], 0U);
  EXPECT_NEAR(settle(compensator, at(0.0, 0.0, 0.0), 1000).delta[1], -16 * increments(GetParam()),
              16);
}

INSTANTIATE_TEST_SUITE_P(BothWays, FinerDrivesTest, ::testing::Values(5e-3, -5e-3));

TEST_F(CompensatorTest, ChangeAtRateLimit_IsNotClamped_OneUnitMoreIs) {
  constexpr std::int64_t kUnitsPerIncrement = 256;
  TestImage made(kJoints);
  made.add_state(format::State::kDirection, 0, 30);
  made.add_term(0, 1, 1e-5, 30);
  const auto correction = [image = made.image()](const CycleInput& input, std::int8_t direction) {
    JointPositions target = {};
    for (std::size_t k = 0; k < kJoints; ++k) {
      target[k] = {input.target[k] * kUnitsPerIncrement};
    }
    Surroundings around;
    around.direction[0] = direction;
    return solve(TableView(image), target, around, *std::make_unique<Workspace>()).delta[0];
  };
  const std::int32_t change = correction(at(0.0), -1) - correction(at(0.1), 1);
  for (const std::int32_t less : {0, 1}) {
    tests::put(made.section(format::Section::kJoints), format::joint::kRateAt,
               (change - less) * 1000);
    Compensator own(config());
    const Bytes image = made.image();
    put_in_force(own, image);
    settle(own, at(0.0));
    settle(own, at(0.1));
    const std::uint32_t before = own.counters().rate_clamped;
    settle(own, at(0.0));
    EXPECT_EQ(own.counters().rate_clamped - before, static_cast<std::uint32_t>(less));
  }
}

TEST_F(CompensatorTest, WayInAWrappingRange_IsTheShortest) {
  const PositionBounds bounds = {.range_low = -100, .range_high = 99};
  EXPECT_EQ(bounds.way(100), 100);
  EXPECT_EQ(bounds.way(101), -99);
  EXPECT_EQ(bounds.way(-100), -100);
  EXPECT_EQ(bounds.way(-101), 99);
}

TEST_F(CompensatorTest, RangeOfOnePosition_DoesNotWrap) {
  // 0x607B (position range limit): both ends are zero until they are written.
  const PositionBounds bounds = {.range_low = 0, .range_high = 0};
  EXPECT_FALSE(bounds.wraps());
  EXPECT_EQ(bounds.way(5), 5);
  EXPECT_EQ(bounds.wrapped(1), 1);
}

TEST_F(CompensatorTest, ResumeWithoutATable_StaysInPassThrough) {
  activate(offset_table(1e-3));
  compensator.disable();
  settle(compensator, at(0.2));
  compensator.park();
  compensator.resume();
  EXPECT_EQ(compensator.cycle(at(0.2)).state, CompensatorState::kPassThrough);
}

TEST_F(CompensatorTest, IncrementsPerTurn_ComeFromTheTable) {
  EXPECT_EQ(compensator.scale(0).per_turn, 0) << "not known without a table";
  activate(offset_table(1e-3));
  EXPECT_EQ(compensator.scale(0).per_turn, 1 << 24);
}

TEST_F(CompensatorTest, CorrectedTarget_IsClampedAtThePositionLimit) {
  activate(offset_table(-5e-3));
  const std::int32_t limit = increments(0.2);
  compensator.set_bounds(0, {.limit_low = -limit, .limit_high = limit});
  std::int32_t last = settle(compensator, at(0.15)).corrected[0];
  EXPECT_GT(last, increments(0.15));
  for (double angle = 0.15; angle < 0.25; angle += 1e-4) {
    const CycleOutput output = compensator.cycle(at(angle));
    EXPECT_LE(output.corrected[0], std::max(limit, increments(angle)));
    EXPECT_LE(std::abs(output.corrected[0] - last), increments(1e-4) + 2) << "no step at the limit";
    last = output.corrected[0];
  }
}

TEST_F(CompensatorTest, PositionLimits_InAWrappingRange_Hold) {
  const auto within = [this](const PositionBounds& bounds, std::int64_t corrected,
                             std::int32_t plain) {
    compensator.set_bounds(0, bounds);
    return compensator.bounds(0).within_limits(corrected, plain);
  };
  const PositionBounds both{
      .range_low = -1000, .range_high = 999, .limit_low = -500, .limit_high = 500};
  EXPECT_EQ(within(both, 510, 495), 500);
  EXPECT_EQ(within(both, -510, -495), -500);
  EXPECT_EQ(within(both, 310, 300), 310);
  EXPECT_EQ(within(both, 530, 520), 520) << "the plain target itself is beyond";
  // With one limit, the other end of the range is a limit too: a wrap would pass the first.
  const PositionBounds upper{.range_low = -1000, .range_high = 999, .limit_high = 500};
  EXPECT_EQ(within(upper, -1010, -995), -1000);
  EXPECT_EQ(within(upper, 510, 495), 500);
  const PositionBounds lower{.range_low = -1000, .range_high = 999, .limit_low = -500};
  EXPECT_EQ(within(lower, 1010, 995), 999);
  // The limits permit the whole range: the axis may turn on past its ends.
  const PositionBounds whole{
      .range_low = -1000, .range_high = 999, .limit_low = -1000, .limit_high = 999};
  EXPECT_EQ(within(whole, 1010, 995), 1010);
  EXPECT_EQ(within(whole, -1010, -995), -1010);
  // The limits permit no position of the range: they are ignored.
  const PositionBounds none{
      .range_low = -1000, .range_high = 999, .limit_low = 2000, .limit_high = 3000};
  EXPECT_EQ(within(none, 510, 495), 510);
}

TEST_F(CompensatorTest, WrappingPositions_AreCorrectedAcrossTheWrap) {
  activate(offset_table(-5e-3));
  const PositionBounds turn{.range_low = 0, .range_high = 16777215};
  compensator.set_bounds(0, turn);
  CycleInput input = at(0.2);
  std::int32_t last = settle(compensator, input).corrected[0];
  for (std::int64_t way = input.target[0]; way < 3 * 16777216; way += 20000) {
    input.target[0] = static_cast<std::int32_t>(way % 16777216);
    const CycleOutput output = compensator.cycle(input);
    ASSERT_GE(output.corrected[0], 0);
    ASSERT_LE(output.corrected[0], 16777215);
    EXPECT_NEAR(static_cast<double>(turn.way(std::int64_t{output.corrected[0]} - last)), 20000,
                20000);
    EXPECT_NEAR(output.delta[0], increments(5e-3), 2);
    const std::int32_t taken_off = compensator.correction_of(output.cycle, 0);
    ASSERT_EQ(turn.wrapped(std::int64_t{output.corrected[0]} - taken_off), input.target[0]);
    last = output.corrected[0];
  }
}

TEST_F(CompensatorTest, MagnitudeIsLimitedByTheTableAndCounted) {
  TestImage made(kJoints);
  made.add_constant(0, 0.02);
  const std::int32_t limit = 1 << 22;  // 2^-10 turn
  tests::put(made.section(format::Section::kJoints), format::joint::kMagnitudeAt, limit);
  activate(made.image());
  const CycleOutput output = settle(compensator, at(0.1));
  EXPECT_EQ(output.delta[0], -(limit >> 8));
  EXPECT_TRUE((output.flags & kMagnitudeClamped) != 0);
  const CycleCounters& counters = compensator.counters();
  EXPECT_GT(counters.magnitude_clamped, 100U);
  EXPECT_EQ(counters.clamped[0], counters.magnitude_clamped) << "its own, and no other's:";
  for (std::size_t k = 1; k < kMaxJoints; ++k) EXPECT_EQ(counters.clamped[k], 0U);
}

// The corrections of joints 0 and 1, ±20 mrad, largely cancel at the tool. The limit of joint 0 is
// below a third of that.
Bytes table_of_cancelling_corrections(std::int32_t limit_of_joint_0) {
  TestImage made(kJoints);
  made.add_constant(0, 0.02);
  made.add_constant(1, -0.02);
  tests::put(made.section(format::Section::kJoints), format::joint::kMagnitudeAt, limit_of_joint_0);
  return made.image();
}

// Distance of that arm's tool from its commanded position, metres.
double tool_error(const CycleInput& input, const std::array<std::int32_t, kMaxJoints>& sent) {
  constexpr std::array<double, kJoints> kArmIsOffBy = {0.02, -0.02, 0.0};
  std::array<double, 2> error = {};
  double commanded = 0.0;
  double real = 0.0;
  for (std::size_t k = 0; k < kJoints; ++k) {
    commanded += input.target[k] / kIncrementsPerRadian;
    real += sent[k] / kIncrementsPerRadian + kArmIsOffBy[k];
    error[0] += 0.5 * (std::cos(real) - std::cos(commanded));
    error[1] += 0.5 * (std::sin(real) - std::sin(commanded));
  }
  return std::hypot(error[0], error[1]);
}

TEST_F(CompensatorTest, CorrectionBeyondOneJointsLimit_IsScaledAtAllJoints) {
  constexpr std::int32_t kLimit = 1 << 22;  // 2^-10 turn, 6.1 mrad
  activate(table_of_cancelling_corrections(kLimit));
  const CycleInput input = at(0.1, 0.4, -0.3);
  const CycleOutput output = settle(compensator, input);
  EXPECT_EQ(output.delta[0], -(kLimit >> 8)) << "the joint that wants too much is at its limit";
  EXPECT_NEAR(output.delta[1], kLimit >> 8, 1) << "and the others have the same share of theirs";
  const double uncorrected = tool_error(input, input.target);
  EXPECT_LT(tool_error(input, output.corrected), 0.75 * uncorrected);
  EXPECT_GT(compensator.counters().clamped[0], 100U);
  EXPECT_EQ(compensator.counters().clamped[1], 0U) << "joint 1 is within its own limit";
}

TEST_F(CompensatorTest, ZeroLimitOfOneJoint_ZeroesAllCorrections) {
  activate(table_of_cancelling_corrections(0));
  const CycleInput input = at(0.1, 0.4, -0.3);
  const CycleOutput output = settle(compensator, input);
  EXPECT_EQ(output.corrected, input.target);
  EXPECT_TRUE((output.flags & kMagnitudeClamped) != 0);
}

TEST_F(CompensatorTest, BlendBeyondAJointLimit_KeepsCorrectionDirection) {
  activate(table_of_cancelling_corrections(1 << 22));
  const CycleInput input = at(0.1, 0.4, -0.3);
  for (int cycle = 0; cycle < 300; ++cycle) {
    const CycleOutput output = compensator.cycle(input);
    ASSERT_NEAR(output.delta[0], -output.delta[1], 1) << cycle;
  }
}

TEST_F(CompensatorTest, Blend_WithHeldJointAtScaledCorrection_Ends) {
  activate(table_of_cancelling_corrections(1 << 22));
  CycleInput input = at(0.1, 0.4, -0.3);
  settle(compensator, input);
  compensator.park();
  compensator.resume();
  input.held = 1;
  EXPECT_EQ(settle(compensator, input).state, CompensatorState::kActive);
}

TEST_F(CompensatorTest, NoTableRaisesTheCompileTimeLimits) {
  TestImage made(kJoints);
  made.add_constant(0, 0.49);  // 0.078 turn, beyond 0.05
  for (std::size_t k = 0; k < kJoints; ++k) {
    const std::size_t joint = k * format::joint::kLength;
    tests::put(made.section(format::Section::kJoints), joint + format::joint::kMagnitudeAt,
               std::int32_t{0x7FFFFFFF});
    tests::put(made.section(format::Section::kJoints), joint + format::joint::kRateAt,
               std::int32_t{0x7FFFFFFF});
  }
  activate(made.image());
  std::int32_t last = 0;
  for (int i = 0; i < 3000; ++i) {
    const std::int32_t delta = compensator.cycle(at(0.1)).delta[0];
    EXPECT_LE(std::abs(delta), (kMaxDeltaRevolute >> 8) + 1);
    EXPECT_LE(std::abs(delta - last), (kMaxRateRevolute >> 8) / 1000 + 2);
    last = delta;
  }
  EXPECT_NEAR(last, -(kMaxDeltaRevolute >> 8), 1);
}

TEST_F(CompensatorTest, RateIsLimitedAndCounted) {
  // Backlash of joint 0: its sign flips with the direction, faster than the table allows.
  TestImage made(kJoints);
  made.add_state(format::State::kDirection, 0, 30);
  made.add_term(0, 1, 5e-3, 30);
  tests::put(made.section(format::Section::kJoints), format::joint::kRateAt,
             static_cast<std::int32_t>(1 << 24));  // 2^-8 turn per second
  activate(made.image());
  std::int32_t last = 0;
  int reversals = 0;
  for (int i = 0; i < 3000; ++i) {
    const CycleOutput output = compensator.cycle(at(0.1 * std::sin(i * 0.01)));
    EXPECT_LE(std::abs(output.delta[0] - last), ((1 << 24) / 1000 >> 8) + 2) << i;
    reversals += (output.delta[0] > 0) != (last > 0) ? 1 : 0;
    last = output.delta[0];
  }
  EXPECT_GT(reversals, 5);
  EXPECT_GT(compensator.counters().rate_clamped, 100U);
  EXPECT_EQ(compensator.counters().clamped[0], compensator.counters().rate_clamped);
}

TEST_F(CompensatorTest, DirectionNeedsMoreThanTheDeadBand) {
  TestImage made(kJoints);
  made.add_state(format::State::kDirection, 0, 30);
  made.add_term(0, 1, 1e-3, 30);
  activate(made.image());
  const std::int32_t backlash = increments(1e-3);
  CycleInput input = at(0.0);
  const auto move = [&](std::int32_t by) {
    input.target[0] += by;
    return settle(compensator, input).delta[0];
  };
  EXPECT_EQ(settle(compensator, input).delta[0], 0);  // never moved: no direction
  EXPECT_EQ(move(60), 0);                             // within the dead band of 100
  EXPECT_EQ(move(40), 0);                             // exactly the dead band
  EXPECT_NEAR(move(20), -backlash, 1);                // 120: moved up
  EXPECT_NEAR(move(-90), -backlash, 1);               // noise
  EXPECT_NEAR(move(80), -backlash, 1);
  EXPECT_NEAR(move(-90), -backlash, 1);  // does not add up: the anchor is the furthest point
  EXPECT_NEAR(move(-20), backlash, 1);   // 110 below it: moved down
  compensator.restart_stream();
  EXPECT_NEAR(move(0), backlash, 1);  // the same target again: the direction is kept
  compensator.restart_stream();
  EXPECT_NEAR(move(80), backlash, 1);  // within the dead band
  compensator.restart_stream();
  EXPECT_EQ(move(30), 0);  // 110 from its last target: direction unknown
  EXPECT_EQ(move(100), 0);
  EXPECT_NEAR(move(1), -backlash, 1);
  compensator.forget_direction(1);
  EXPECT_NEAR(move(0), -backlash, 1) << "another joint's";
  compensator.forget_direction(0);
  EXPECT_EQ(move(0), 0);
}

TEST_F(CompensatorTest, ReversedDrive_DirectionIsThatOfTheJoint) {
  TestImage made(kJoints);
  made.add_state(format::State::kDirection, 0, 30);
  made.add_term(0, 1, 1e-3, 30);
  tests::Bytes& joints = made.section(format::Section::kJoints);
  for (const std::size_t at :
       {format::joint::kUnitPerIncrementAt, format::joint::kIncrementPerUnitAt}) {
    tests::put(joints, at, -load_i32(&joints[at]));
  }
  const std::int32_t backlash = increments(1e-3);
  activate(offset_table(0));  // not reversed, with the same dead band
  CycleInput input = at(0.0);
  compensator.cycle(input);
  input.target[0] += 1000;
  compensator.cycle(input);
  activate(made.image());
  EXPECT_NEAR(settle(compensator, input).delta[0], -backlash, 1) << "it came down before the table";
  input.target[0] -= 1000;
  EXPECT_NEAR(settle(compensator, input).delta[0], backlash, 1) << "the joint moves up";
  input.target[0] += 1000;
  EXPECT_NEAR(settle(compensator, input).delta[0], -backlash, 1);
}

TEST_F(CompensatorTest, TableThatCountsDown_KeepsTheCorrectionInIncrements) {
  for (const bool counts_down : {false, true}) {
    Compensator own(config());
    std::deque<Bytes> images;
    for (const bool is_second : {false, true}) {
      // Both tables want the same correction in increments.
      const bool flips = is_second != counts_down;
      TestImage made(kJoints);
      made.add_constant(0, flips ? -5e-4 : 5e-4);
      tests::Bytes& joints = made.section(format::Section::kJoints);
      tests::put(joints, format::joint::kRateAt, kMinRate);
      for (const std::size_t at :
           {format::joint::kUnitPerIncrementAt, format::joint::kIncrementPerUnitAt}) {
        if (flips) tests::put(joints, at, -load_i32(&joints[at]));
      }
      images.push_back(made.image());
      put_in_force(own, images.back());
      if (!is_second) settle(own, at(0.2), 30'000);
    }
    const std::int32_t before = own.correction_of(29'999, 0);
    ASSERT_NEAR(std::abs(before), increments(5e-4), 1);
    for (int k = 0; k < 3000; ++k) {
      const CycleOutput output = own.cycle(at(0.2));
      ASSERT_NEAR(output.delta[0], before, 2) << k;
      if (k == 0) own.take_back();
    }
  }
}

// The position of a joint is target less zero, which needs 33 bits.
TEST_F(CompensatorTest, Zero_FarFromTheTarget_GivesTheSameAngle) {
  constexpr std::int32_t kTurn = 1 << 24;
  const auto correction = [](std::int32_t zero, std::int32_t target) {
    TestImage made(kJoints);
    made.add_harmonic(0, 0, 1.0, 0.1, 2e-3);
    tests::put(made.section(format::Section::kJoints), format::joint::kZeroAt, zero);
    const Bytes image = made.image();
    Compensator own(config());
    put_in_force(own, image);
    CycleInput input;
    input.target[0] = target;
    return settle(own, input).delta[0];
  };
  const std::int32_t expected = correction(0, 123'456);
  ASSERT_NE(expected, 0);
  for (const std::int32_t turns : {1, 100, 127}) {
    EXPECT_EQ(correction(-turns * kTurn, turns * kTurn + 123'456), expected) << turns;
    EXPECT_EQ(correction(turns * kTurn, -turns * kTurn + 123'456), expected) << turns;
  }
}

TEST(PositionBoundsTest, WayOverManyTurns_IsTheShortest) {
  const PositionBounds turn{.range_low = 0, .range_high = 999};
  for (const std::int64_t turns : {-2'000'000, -3, -2, -1, 0, 1, 2, 3, 2'000'000}) {
    EXPECT_EQ(turn.way(turns * 1000 + 400), 400) << turns;
    EXPECT_EQ(turn.way(turns * 1000 - 400), -400) << turns;
  }
}

TEST_F(CompensatorTest, RestartStreamBeforeTakeBack_StaysInEffect) {
  TestImage made(kJoints);
  made.add_state(format::State::kDirection, 0, 30);
  made.add_term(0, 1, 1e-3, 30);
  activate(made.image());
  compensator.cycle(at(0.0));
  settle(compensator, at(0.1));
  compensator.restart_stream();
  compensator.take_back();
  EXPECT_EQ(settle(compensator, at(0.2)).delta[0], 0);
}

TEST_F(CompensatorTest, NeededInputs_AreThoseOfTheActiveTable) {
  EXPECT_EQ(compensator.needed_inputs(), 0U);
  TestImage made(kJoints);
  made.header()[format::header::kSensorCountAt] = 2;
  for (int sensor = 0; sensor < 2; ++sensor) {
    made.add(format::Section::kSensors, Bytes(format::sensor::kLength));
  }
  made.add_state(format::State::kTemperature, 1, 20);
  activate(made.image());
  EXPECT_EQ(compensator.needed_inputs(), 2U) << "the second sensor's";
  made.add_state(format::State::kPayload, 0, 20);
  activate(made.image());
  EXPECT_EQ(compensator.needed_inputs(), 2U | 1U << kMaxSensors);
  compensator.disable();
  EXPECT_EQ(compensator.needed_inputs(), 0U);
}

TEST_F(CompensatorTest, Forget_DiscardsTheHeldCorrection) {
  activate(offset_table(5e-3));
  std::array<std::int32_t, kJoints> held = {};
  held[0] = 1000;
  EXPECT_TRUE(compensator.begin(held));
  compensator.forget();
  EXPECT_EQ(compensator.state(), CompensatorState::kPassThrough);
  EXPECT_EQ(compensator.cycle(at(0.2)).delta[0], 0);
  EXPECT_TRUE(compensator.begin(held));
  EXPECT_EQ(settle(compensator, at(0.2)).delta[0], -increments(5e-3)) << "a start like any other";
}

// Backlash of joint 1 of plus or minus 1e-3 by direction, and a joint that comes to rest after a
// long motion and one small step back.
class UntabledDirectionTest : public CompensatorTest {
 protected:
  static Bytes backlash_table(std::int32_t dead_band) {
    TestImage made(kJoints);
    made.add_state(format::State::kDirection, 0, 30);
    made.add_term(0, 1, 1e-3, 30);
    tests::put(made.section(format::Section::kJoints), format::joint::kDeadBandAt, dead_band);
    return made.image();
  }
  void move_and_settle_back(std::int32_t back) {
    compensator.cycle(input);
    input.target[0] += 20'000;
    compensator.cycle(input);
    input.target[0] -= back;
    compensator.cycle(input);
  }
  std::int32_t correction() { return settle(compensator, input).delta[0]; }

  CycleInput input = at(0.0);
};

TEST_F(UntabledDirectionTest, Disabled_KeepsTheLastDeadBand) {
  for (const std::int32_t back : {100, 101}) {
    activate(backlash_table(100));
    compensator.disable();
    move_and_settle_back(back);
    activate(backlash_table(100));
    EXPECT_NEAR(correction(), increments(back > 100 ? 1e-3 : -1e-3), 1);
  }
}

TEST_F(UntabledDirectionTest, FirstTable_FindsTheDirectionUnknown) {
  move_and_settle_back(1);
  activate(backlash_table(100));
  EXPECT_EQ(correction(), 0);
  input.target[0] += 100;
  EXPECT_EQ(correction(), 0) << "the dead band counts from where the joint stands";
  input.target[0] += 1;
  EXPECT_NEAR(correction(), -increments(1e-3), 1);
}

TEST_F(UntabledDirectionTest, LargerDeadBand_MakesTheDirectionUnknown) {
  activate(backlash_table(10));
  move_and_settle_back(50);
  EXPECT_NEAR(correction(), increments(1e-3), 1);
  activate(backlash_table(10));
  EXPECT_NEAR(correction(), increments(1e-3), 1);
  activate(backlash_table(100));
  EXPECT_EQ(correction(), 0);
}

TEST_F(CompensatorTest, CorrectionOf_UndoesTheOutputOfThatCycle) {
  TestImage made(kJoints);
  made.add_harmonic(0, 0, 3.0, 0.0, 5e-3);
  activate(made.image());
  settle(compensator, at(0.0));
  std::vector<CycleOutput> outputs;
  std::vector<CycleInput> inputs;
  for (int i = 0; i < 40; ++i) {
    inputs.push_back(at(0.01 * i));
    outputs.push_back(compensator.cycle(inputs.back()));
  }
  for (std::size_t late = 0; late < kFeedbackHistory; ++late) {
    const std::size_t i = outputs.size() - 1 - late;
    // Ideal drives reach the corrected target: the controller must see its own command.
    for (std::size_t k = 0; k < kJoints; ++k) {
      EXPECT_EQ(outputs[i].corrected[k] - compensator.correction_of(outputs[i].cycle, k),
                inputs[i].target[k]);
    }
  }
  const std::size_t old = outputs.size() - 1 - kFeedbackHistory;
  ASSERT_NE(outputs[old].delta[0], 0);
  EXPECT_EQ(compensator.correction_of(outputs[old].cycle, 0), 0);
  EXPECT_EQ(compensator.correction_of(outputs.back().cycle + 1, 0), 0);
}

TEST_F(CompensatorTest, CorrectionIsContinuousAcrossTheTurnAndAcrossCells) {
  TestImage made(kJoints);
  made.add_harmonic(0, 0, 13.0, 0.1, 2e-3);
  made.add_table(0, -1.0, 0.25, {1e-3, -1e-3, 2e-3, -2e-3, 5e-4, 0.0, 1e-3, -1e-3, 2e-3}, 22,
                 0x1BF);
  activate(made.image());
  settle(compensator, at(-3.5));
  const double step = 1e-4;
  std::int32_t last = compensator.cycle(at(-3.5)).delta[0];
  std::uint16_t met = kCycleClean;
  // Slopes: 13 · 2 mrad per rad and 4 mrad per cell of 0.25 rad. Three increments for rounding.
  const double most = increments(step * (13.0 * 2e-3 + 4e-3 / 0.25) * 1.1) + 3.0;
  for (double q = -3.5; q < 3.5; q += step) {
    const CycleOutput output = compensator.cycle(at(q));
    ASSERT_LE(std::abs(output.delta[0] - last), most) << q;
    last = output.delta[0];
    met = static_cast<std::uint16_t>(met | output.flags);
  }
  EXPECT_NE(met & kOutsideCoverage, 0);
}

TEST_F(CompensatorTest, OutputSaturatesInsteadOfWrapping) {
  activate(offset_table(-5e-3));
  CycleInput input = at(0.0);
  input.target[0] = std::numeric_limits<std::int32_t>::max() - 3;
  const CycleOutput output = settle(compensator, input);
  EXPECT_EQ(output.corrected[0], std::numeric_limits<std::int32_t>::max());
  EXPECT_EQ(output.delta[0], 3);
  EXPECT_TRUE((output.flags & kOutputSaturated) != 0);
}

TEST_F(CompensatorTest, Correction_IsSmoothThroughTheStretchedArm) {
  // The planar arm stretched out: the radial direction is lost, and the error points along it.
  TestImage made(kJoints);
  made.add_constant(8 + 6, 2e-3);
  activate(made.image());
  settle(compensator, at(0.2, -0.3, -0.3));
  CycleOutput last = compensator.cycle(at(0.2, -0.3, -0.3));
  std::uint16_t met = kCycleClean;
  for (double bend = -0.3; bend < 0.3; bend += 2e-4) {
    const CycleOutput output = compensator.cycle(at(0.2, bend, bend));
    for (std::size_t k = 0; k < kJoints; ++k) {
      // Two steps of at most e / 2λ each, e = 2 mm and λ = 20 mm.
      ASSERT_LE(std::abs(output.delta[k]), increments(0.1) + 1);
      ASSERT_LE(std::abs(output.delta[k] - last.delta[k]), increments(2e-3)) << bend;
    }
    last = output;
    met = static_cast<std::uint16_t>(met | output.flags);
  }
  EXPECT_NE(met & kNearSingular, 0);
}

}  // namespace
}  // namespace armtrue
