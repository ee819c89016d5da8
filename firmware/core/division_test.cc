#include "firmware/core/division.h"

#include <gtest/gtest.h>

#include <random>

namespace armtrue {
namespace {

TEST(DivisionTest, IsTheProcessorsOwn) {
  std::mt19937_64 random(1);
  for (int i = 0; i < 200000; ++i) {
    const std::uint64_t x = random() >> (random() % 64U);
    const auto divisor = static_cast<std::uint16_t>(1U + random() % 65535U);
    ASSERT_EQ(quotient(x, divisor), x / divisor) << x << " / " << divisor;
    ASSERT_EQ(milliseconds_of(x), x / 1000U);
    const auto amount = static_cast<std::uint32_t>(random() >> 33U);
    const auto parts = static_cast<std::uint32_t>(random() >> 33U);
    ASSERT_EQ(millionths(amount, parts), std::uint64_t{amount} * parts / 1000000U);
  }
  EXPECT_EQ(quotient(~std::uint64_t{0}, 1), ~std::uint64_t{0});
  EXPECT_EQ(quotient(0, 7), 0U);
}

}  // namespace
}  // namespace armtrue
