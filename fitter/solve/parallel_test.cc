#include "fitter/solve/parallel.h"

#include <gtest/gtest.h>

#include <numeric>
#include <stdexcept>

namespace armtrue {
namespace {

TEST(InParallel, DoesEveryJobOnce) {
  for (const std::size_t count : {0U, 1U, 2U, 1000U}) {
    std::vector<int> done(count, 0);
    in_parallel(count, [&](std::size_t k) { ++done[k]; });
    EXPECT_EQ(done, std::vector<int>(count, 1));
  }
}

TEST(InParallel, ThrowsOnWhatAJobThrew) {
  EXPECT_THROW(in_parallel(50,
                           [](std::size_t k) {
                             if (k == 17) throw std::runtime_error("job 17");
                           }),
               std::runtime_error);
}

}  // namespace
}  // namespace armtrue
