// A minute of simulated motion with every fault of soak.h at random; step 15 of ./dev test runs
// hours.
#include "firmware/testing/soak.h"

#include <gtest/gtest.h>

#include "firmware/testing/drive_soak.h"

namespace armtrue::canopen {
namespace {

constexpr std::uint64_t kMinute = 60'000;

TEST(SoakTest, WithoutFaults_EveryCycleIsOutput) {
  Soak soak(1, 0.0);
  EXPECT_EQ(soak.run(2000), "");
  EXPECT_EQ(soak.figures().outputs, 1999U) << "a stream begins with its second set";
  EXPECT_EQ(soak.figures().feedback_checked, 6U * 1999U);
  EXPECT_EQ(soak.figures().forwarded, 4000U);
}

TEST(SoakTest, WithoutFaults_OffsetsInEveryCycleAfterStandstill) {
  Soak soak(1, 0.0, false, Mode::kOffset);
  EXPECT_EQ(soak.run(2000), "");
  // The actual positions after 0.1 s of standing come behind the set of that cycle.
  EXPECT_EQ(soak.figures().outputs, 1898U);
  EXPECT_EQ(soak.figures().feedback_checked, 6U * 1898U);
}

class SoakSeedTest : public testing::TestWithParam<std::uint32_t> {};

TEST_P(SoakSeedTest, OneMinuteOfRandomFaults_JudgeFindsNothing) {
  const std::uint32_t seed = GetParam();
  Soak soak(seed, 2.0, seed % 2 == 0, seed <= 4 ? Mode::kInline : Mode::kOffset);
  EXPECT_EQ(soak.run(kMinute), "");
  EXPECT_GT(soak.figures().outputs, kMinute / 10);
  for (std::size_t k = 0; k < kFaults; ++k) {
    EXPECT_GT(soak.figures().faults[k], 10U) << name_of(static_cast<Fault>(k));
  }
}

// Here NMT start comes in the last cycle of a fade that a full bus made longer.
TEST(SoakTest, StartDuringTheLastStepOfAFade_JudgeFindsNothing) {
  Soak soak(18, 1.0, false, Mode::kOffset);
  EXPECT_EQ(soak.run(170'000), "");
}

INSTANTIATE_TEST_SUITE_P(Seeds, SoakSeedTest, testing::Range(1U, 7U));

class DriveSoakTest : public testing::TestWithParam<Mode> {};

TEST_P(DriveSoakTest, FiveMinutesOfDriveEvents_JudgeFindsNothing) {
  DriveSoak soak(1, GetParam());
  EXPECT_EQ(soak.run(5 * kMinute), "");
  EXPECT_EQ(soak.figures().came_back, soak.figures().suspended);
  EXPECT_GT(soak.figures().suspended, 20U);
  EXPECT_GT(soak.figures().wraps, 10U);
  for (std::size_t k = 0; k < kDriveEvents; ++k) {
    EXPECT_GT(soak.figures().events[k], 2U) << name_of(static_cast<DriveEvent>(k));
  }
}

TEST_P(DriveSoakTest, DisabledCorrection_IsDetectedByTheJudge) {
  DriveSoak soak(1, GetParam());
  soak.disable_correction();
  soak.run_settled(200);
  EXPECT_NE(soak.failure(), "");
}

INSTANTIATE_TEST_SUITE_P(Modes, DriveSoakTest, testing::Values(Mode::kInline, Mode::kOffset));

TEST(SoakTest, DisabledCorrection_IsDetectedByTheJudge) {
  Soak soak(1, 0.0);
  ASSERT_EQ(soak.run(100), "");
  soak.disable_correction();
  EXPECT_NE(soak.run(200), "");
}

}  // namespace
}  // namespace armtrue::canopen
