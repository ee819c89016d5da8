#include "fitter/common/parallel.h"

#include <gtest/gtest.h>

#include <numeric>
#include <stdexcept>
#include <thread>
#include <vector>

namespace armtrue {
namespace {

TEST(InParallel, RunsEveryJobOnce) {
  for (const std::size_t count : {0U, 1U, 2U, 1000U}) {
    std::vector<int> done(count, 0);
    in_parallel(count, [&](std::size_t k) { ++done[k]; });
    EXPECT_EQ(done, std::vector<int>(count, 1));
  }
}

TEST(InParallel, RethrowsTheExceptionOfAJob) {
  EXPECT_THROW(in_parallel(50,
                           [](std::size_t k) {
                             if (k == 17) throw std::runtime_error("job 17");
                           }),
               std::runtime_error);
}

TEST(InParallel, CalledWithinAJob_StaysOnThatThread) {
  std::vector<int> strayed(8, 0);
  in_parallel(strayed.size(), [&](std::size_t k) {
    const std::thread::id own = std::this_thread::get_id();
    in_parallel(100, [&](std::size_t) {
      if (std::this_thread::get_id() != own) strayed[k] = 1;
    });
  });
  EXPECT_EQ(strayed, std::vector<int>(8, 0));
}

TEST(InParallel, AfterItsJobs_CallersThreadIsNoLongerMarkedBusy) {
  in_parallel(10, [](std::size_t) {});
  EXPECT_FALSE(is_one_of_many());
}

}  // namespace
}  // namespace armtrue
