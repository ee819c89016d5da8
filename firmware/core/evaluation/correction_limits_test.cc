#include "firmware/core/evaluation/correction_limits.h"

#include <gtest/gtest.h>

#include <cstdlib>
#include <random>

namespace armtrue {
namespace {

TEST(ScaleIntoLimitsTest, CorrectionWithinAllLimits_StaysAsItIs) {
  JointAmounts correction = {100, -200, 0};
  EXPECT_EQ(scale_into_limits({100, 200, 0}, 3, correction), 0U);
  EXPECT_EQ(correction, (JointAmounts{100, -200, 0}));
}

TEST(ScaleIntoLimitsTest, WorstJointEndsAtItsLimit_OthersHaveTheSameShare) {
  // 1000/300 is the larger excess than 900/600.
  JointAmounts correction = {-900, 1000, 10, -7};
  EXPECT_EQ(scale_into_limits({600, 300, 10000, 10000}, 4, correction), 0b0011U);
  EXPECT_EQ(correction, (JointAmounts{-270, 300, 3, -2})) << "rounded towards zero";
}

TEST(ScaleIntoLimitsTest, LimitOfZero_ZeroesAllJoints) {
  for (const std::size_t without : {0U, 1U, 2U}) {
    JointAmounts largest = {10, 10, 10};
    largest[without] = 0;
    JointAmounts correction = {100000, -1, 1};
    scale_into_limits(largest, 3, correction);
    EXPECT_EQ(correction, JointAmounts{}) << without;
  }
}

TEST(ScaleIntoLimitsTest, LimitOfZero_OnUncorrectedJoint_HasNoEffect) {
  JointAmounts correction = {5, 0};
  EXPECT_EQ(scale_into_limits({10, 0}, 2, correction), 0U);
  EXPECT_EQ(correction, (JointAmounts{5, 0}));
}

TEST(ScaleIntoLimitsTest, JointsBeyondTheCount_AreIgnored) {
  JointAmounts correction = {5, 999};
  EXPECT_EQ(scale_into_limits({10, 0}, 1, correction), 0U);
  EXPECT_EQ(correction, (JointAmounts{5, 999}));
}

TEST(ScaleIntoLimitsTest, AnyCorrection_EndsWithinItsLimitsInItsDirection) {
  std::mt19937 random(1);
  constexpr std::array<std::int32_t, 4> kEnds = {INT32_MIN, INT32_MAX, INT32_MIN + 1, 1};
  for (int round = 0; round < 20000; ++round) {
    JointAmounts largest;
    JointAmounts wanted;
    for (std::size_t k = 0; k < kMaxJoints; ++k) {
      const std::int32_t most = random() % 2 == 0 ? kMaxDeltaRevolute : kMaxDeltaPrismatic;
      largest[k] = random() % 8 == 0 ? most : static_cast<std::int32_t>(random() >> 4U) % most;
      wanted[k] = static_cast<std::int32_t>(random()) >> (random() % 32);
      if (random() % 16 == 0) wanted[k] = kEnds[random() % kEnds.size()];
    }
    JointAmounts scaled = wanted;
    const std::uint32_t beyond = scale_into_limits(largest, kMaxJoints, scaled);
    double share = 1.0;
    for (std::size_t k = 0; k < kMaxJoints; ++k) {
      const double size = std::abs(static_cast<double>(wanted[k]));
      ASSERT_EQ(beyond >> k & 1U, size > largest[k] ? 1U : 0U);
      if (size > largest[k]) share = std::min(share, largest[k] / size);
    }
    bool is_one_at_its_limit = beyond == 0U;
    for (std::size_t k = 0; k < kMaxJoints; ++k) {
      ASSERT_LE(std::abs(std::int64_t{scaled[k]}), largest[k]);
      // Rounding of the share, up to half a unit, and rounding towards zero.
      ASSERT_NEAR(scaled[k], share * wanted[k], 1.0);
      ASSERT_GE(std::int64_t{scaled[k]} * wanted[k], 0);
      is_one_at_its_limit =
          is_one_at_its_limit ||
          ((beyond >> k & 1U) != 0U && std::abs(std::int64_t{scaled[k]}) == largest[k]);
    }
    ASSERT_TRUE(is_one_at_its_limit);
  }
}

}  // namespace
}  // namespace armtrue
