// Quantiles from a histogram: within an eighth of the true value.
#include "firmware/canopen/motion/latency.h"

#include <gtest/gtest.h>

namespace armtrue::canopen {
namespace {

Latency of(std::initializer_list<std::uint32_t> values) {
  Latency latency;
  for (const std::uint32_t value : values) latency.note(value);
  return latency;
}

TEST(LatencyTest, NoValues_AllStatisticsAreZero) {
  const Latency none;
  EXPECT_EQ(none.least(), 0U);
  EXPECT_EQ(none.quantile(500), 0U);
  EXPECT_EQ(none.most(), 0U);
}

TEST(LatencyTest, OneValue_IsEveryQuantile) {
  const Latency one = of({9});
  EXPECT_EQ(one.least(), 9U);
  EXPECT_EQ(one.quantile(1), 9U);
  EXPECT_EQ(one.quantile(500), 9U);
  EXPECT_EQ(one.most(), 9U);
  EXPECT_EQ(of({0}).most(), 0U);
}

TEST(LatencyTest, Quantile_IsTheSmallestValueThatCoversTheShare) {
  EXPECT_EQ(of({5, 900}).quantile(500), 5U);
  EXPECT_EQ(of({5, 7, 900}).quantile(500), 7U);
  EXPECT_EQ(of({0, 0, 7}).quantile(500), 0U);
}

TEST(LatencyTest, Quantile_IsRoundedUpToTheEndOfItsClass) {
  EXPECT_EQ(of({20, 20, 1000}).quantile(500), 21U) << "16 to 31 in eight classes of two";
  EXPECT_EQ(of({64, 64, 1000}).quantile(500), 71U) << "64 to 127 in eight classes of eight";
}

TEST(LatencyTest, MoreValuesThanAClassCounts_QuantilesStayCorrect) {
  Latency latency;
  for (int k = 0; k < 1'000'000; ++k) latency.note(k % 100 == 0 ? 900U : 5U);
  EXPECT_EQ(latency.count(), 1'000'000U);
  EXPECT_EQ(latency.quantile(980), 5U);
  EXPECT_NEAR(latency.quantile(995), 900, 900 / 8);
  latency.note(5'000'000);
  EXPECT_EQ(latency.quantile(1000), 5'000'000U);
}

TEST(LatencyTest, Quantiles_AreWithinAnEighth) {
  Latency latency;
  for (std::uint32_t value = 1; value <= 10000; ++value) latency.note(value);
  EXPECT_EQ(latency.least(), 1U);
  EXPECT_EQ(latency.most(), 10000U);
  EXPECT_NEAR(latency.quantile(500), 5000, 5000 / 8);
  EXPECT_NEAR(latency.quantile(999), 9990, 9990 / 8);
}

}  // namespace
}  // namespace armtrue::canopen
