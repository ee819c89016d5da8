#include "firmware/core/fixed/fixed.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>
#include <random>

namespace armtrue {
namespace {

TEST(FixedTest, ShiftRoundsToNearest) {
  EXPECT_EQ(round_shift(5, 1), 3);
  EXPECT_EQ(round_shift(-5, 1), -2);
  EXPECT_EQ(round_shift(7, 2), 2);
  EXPECT_EQ(round_shift(std::int64_t{1} << 62, 62), 1);
}

TEST(FixedTest, RoundShift_IsBiasedByTiesOnly) {
  std::int64_t sum = 0;
  for (std::int64_t x = -4096; x < 4096; ++x) sum += round_shift(x, 4) * 16 - x;
  // Ties go up: half a unit of the last place in 1 of 16, which is 1/32 on average.
  EXPECT_EQ(sum, 8192 / 2);
}

TEST(FixedTest, Saturates) {
  EXPECT_EQ(saturate(std::int64_t{1} << 40), std::numeric_limits<std::int32_t>::max());
  EXPECT_EQ(saturate(-(std::int64_t{1} << 40)), std::numeric_limits<std::int32_t>::min());
  EXPECT_EQ(saturate(-17), -17);
}

TEST(FixedTest, RoundHigh_RoundsToNearest_High_RoundsDown) {
  EXPECT_EQ(round_high(1 << 30, 3), 1);  // 0.75
  EXPECT_EQ(round_high(-(1 << 30), 3), -1);
  EXPECT_EQ(high(-(1 << 30), 3), -1);  // floor of -0.75
  EXPECT_EQ(high(1 << 30, 3), 0);
}

TEST(FixedTest, ReciprocalIsGoodTo29Bits) {
  std::mt19937_64 random(1);
  double worst = 0.0;
  for (int i = 0; i < 2000000; ++i) {
    const auto d = static_cast<std::uint32_t>(random() >> (33 + random() % 31)) & 0x7FFFFFFFU;
    if (d == 0) continue;
    const Reciprocal r = reciprocal(d);
    EXPECT_GE(r.mantissa, std::uint32_t{1} << 30);
    EXPECT_LE(r.mantissa, std::uint32_t{1} << 31);
    const double value = std::ldexp(static_cast<double>(r.mantissa), r.exponent - 62);
    worst = std::max(worst, std::abs(value * d - 1.0));
  }
  EXPECT_LT(worst, std::ldexp(1.0, -29));
}

TEST(FixedTest, AddTo_BeyondTheLimit_SaturatesAndReturnsTrue) {
  Coordinate sum = {kMaxCoordinate - 5};
  EXPECT_FALSE(add_to(sum, 5));
  EXPECT_TRUE(add_to(sum, 1));
  EXPECT_EQ(sum.raw, kMaxCoordinate);
  EXPECT_FALSE(add_to(sum, -(1 << 30)));  // back inside: -2^30 + 2^29 is the lower bound itself
  EXPECT_EQ(sum.raw, -kMaxCoordinate);
}

TEST(FixedTest, AnglesConvert) {
  const Coordinate radian = {static_cast<std::int32_t>(std::lround(std::ldexp(0.1, 30)))};
  EXPECT_NEAR(std::ldexp(turns_of(radian), -32) * 2.0 * M_PI, 0.1, 1e-9);
  EXPECT_EQ(within_turn({-(std::int64_t{1} << 32) / 4}).raw, 0xC0000000U);
  EXPECT_NEAR(std::ldexp(length_of(JointPosition{std::int64_t{3} << 31}).raw, -27), 1.5, 1e-8);
}

}  // namespace
}  // namespace armtrue
