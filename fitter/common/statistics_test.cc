#include "fitter/common/statistics.h"

#include <gtest/gtest.h>

#include <cmath>

namespace armtrue {
namespace {

TEST(Statistics, MedianAndQuantileInterpolate) {
  EXPECT_EQ(median({}), 0.0);
  EXPECT_EQ(median({3.0}), 3.0);
  EXPECT_EQ(median({4.0, 1.0}), 2.5);
  EXPECT_EQ(median({9.0, 1.0, 5.0}), 5.0);
  EXPECT_DOUBLE_EQ(quantile({0.0, 1.0, 2.0, 3.0, 4.0}, 0.95), 3.8);
  EXPECT_EQ(quantile({2.0, 7.0}, 0.0), 2.0);
  EXPECT_EQ(quantile({2.0, 7.0}, 1.0), 7.0);
}

TEST(Statistics, Summary) {
  const ErrorSummary s = summarise({3.0, 4.0});
  EXPECT_DOUBLE_EQ(s.mean, 3.5);
  EXPECT_DOUBLE_EQ(s.rms, std::sqrt(12.5));
  EXPECT_DOUBLE_EQ(s.max, 4.0);
  EXPECT_EQ(s.count, 2u);
  EXPECT_EQ(summarise({}).count, 0u);
}

// Values from published tables (Abramowitz and Stegun, 26.8 and 26.9).
TEST(Statistics, ChiSquareAndFSurvivalMatchTables) {
  EXPECT_NEAR(log10_chi2_survival(3.841459, 1.0), std::log10(0.05), 1e-6);
  EXPECT_NEAR(log10_chi2_survival(29.58830, 10.0), std::log10(0.001), 1e-6);
  EXPECT_NEAR(log10_f_survival(4.964603, 1.0, 10.0), std::log10(0.05), 1e-6);
  EXPECT_NEAR(log10_f_survival(2.977, 2.0, 1e9), log10_chi2_survival(2.0 * 2.977, 2.0), 1e-6);
  EXPECT_EQ(log10_f_survival(0.0, 3.0, 10.0), 0.0);
}

// Far in the tail, the logarithm stays finite although the probability itself underflows to zero.
TEST(Statistics, Log10SurvivalStaysFiniteBelowSmallestDouble) {
  // With two degrees of freedom the survival function is exp(-x/2) exactly.
  EXPECT_NEAR(log10_chi2_survival(5000.0, 2.0), -2500.0 / std::log(10.0), 1.0);
  double before = 0.0;
  for (const double f : {10.0, 30.0, 100.0, 300.0, 1000.0, 3000.0}) {
    const double now = log10_f_survival(f, 6.0, 1200.0);
    EXPECT_LT(now, before) << f;
    EXPECT_TRUE(std::isfinite(now));
    before = now;
  }
  EXPECT_LT(before, -600.0);
}

}  // namespace
}  // namespace armtrue
