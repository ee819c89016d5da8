#include "firmware/core/fixed/angle.h"

#include <gtest/gtest.h>

#include <cmath>

namespace armtrue {
namespace {

constexpr double kBound = 2.0e-9;  // as angle.h states it

double exact(std::uint32_t raw) { return std::sin(std::ldexp(raw, -32) * 2.0 * M_PI); }

double error(std::uint32_t raw) { return std::abs(std::ldexp(sine({raw}).raw, -30) - exact(raw)); }

TEST(AngleTest, SineError_OverAWholeTurn_StaysWithinItsBound) {
  double worst = 0.0;
  // An odd stride meets every part of the range; `./dev bench` goes through all 2^32.
  for (std::uint64_t raw = 0; raw < (std::uint64_t{1} << 32); raw += 1021) {
    worst = std::max(worst, error(static_cast<std::uint32_t>(raw)));
  }
  EXPECT_LT(worst, kBound);
}

TEST(AngleTest, QuadrantBorders_AreWithinTwoUnits) {
  EXPECT_EQ(sine({0}).raw, 0);
  EXPECT_EQ(sine({0x80000000U}).raw, 0);
  EXPECT_NEAR(sine({0x40000000U}).raw, kRatioOne.raw, 2);
  EXPECT_NEAR(sine({0xC0000000U}).raw, -kRatioOne.raw, 2);
  EXPECT_NEAR(cosine({0}).raw, kRatioOne.raw, 2);
}

TEST(AngleTest, SineIsOddAndContinuousAcrossTheWrap) {
  for (std::uint32_t raw = 1; raw < 2000; ++raw) {
    EXPECT_NEAR(sine({raw}).raw, -sine({0U - raw}).raw, 2) << raw;
    for (const std::uint32_t border : {0U, 0x40000000U, 0x80000000U, 0xC0000000U}) {
      EXPECT_LE(std::abs(sine({border + raw}).raw - sine({border + raw - 1}).raw), 3) << raw;
    }
  }
}

TEST(AngleTest, SquaresOfSineAndCosine_AddUpToOne) {
  for (std::uint64_t raw = 0; raw < (std::uint64_t{1} << 32); raw += 65537 * 3) {
    const BinaryAngle angle = {static_cast<std::uint32_t>(raw)};
    const double s = std::ldexp(sine(angle).raw, -30);
    const double c = std::ldexp(cosine(angle).raw, -30);
    EXPECT_NEAR(s * s + c * c, 1.0, 3 * kBound) << raw;
  }
}

}  // namespace
}  // namespace armtrue
