#include "firmware/ports/common/bit_timing.h"

#include <gtest/gtest.h>

namespace armtrue::ports {
namespace {

TEST(BitTiming, StandardRates_AreExact_SamplePointIsInRange) {
  for (const std::uint32_t clock : {42'000'000U, 100'000'000U, 24'000'000U}) {
    // The bit rates of CiA 301, table 1.
    for (const std::uint32_t rate : {1'000'000U, 500'000U, 250'000U, 125'000U}) {
      const BitTiming timing = bit_timing(clock, rate);
      ASSERT_NE(timing.prescaler, 0U) << clock << " Hz, " << rate << " bit/s";
      EXPECT_EQ(clock, rate * timing.prescaler * timing.quanta());
      EXPECT_GE(timing.sample_point_permille(), 850U);
      EXPECT_LE(timing.sample_point_permille(), 900U);
      EXPECT_LE(timing.jump_width, timing.segment2);
      EXPECT_LE(timing.segment1, 16U);
      EXPECT_LE(timing.segment2, 8U);
    }
  }
}

TEST(BitTiming, RateThatTheClockCannotGive_IsRefused) {
  EXPECT_EQ(bit_timing(42'000'000, 999'999).prescaler, 0U);
  EXPECT_EQ(bit_timing(1'000'000, 1'000'000).prescaler, 0U);
}

}  // namespace
}  // namespace armtrue::ports
