// The device's clock against a fake timer.
#include "firmware/ports/stm32f405/free_running_clock.h"

#include <gtest/gtest.h>

#include <map>

namespace armtrue::stm32f405 {
namespace {

// TIM2 as RM0090 describes it: it counts its clock divided by the prescaler plus one, which an
// update event loads.
class FakeTimer {
 public:
  std::uint32_t read(std::uint32_t offset) const {
    return offset == 0x24 ? static_cast<std::uint32_t>(count_) : value_.at(offset);
  }
  void write(std::uint32_t offset, std::uint32_t word) {
    value_[offset] = word;
    if (offset != 0x14) return;
    divider_ = value_.at(0x28) + 1;
    count_ = 0;
  }
  // Lets `periods` periods of the timer's clock pass.
  void run(std::uint64_t periods) {
    ASSERT_EQ(value_[0x00], 1U) << "it was not enabled";
    ASSERT_EQ(value_[0x2C], 0xFFFFFFFFU) << "it would begin again before 32 bits are full";
    count_ += periods / divider_;
  }

 private:
  std::map<std::uint32_t, std::uint32_t> value_;
  std::uint64_t divider_ = 1;
  std::uint64_t count_ = 0;
};

class FreeRunningClockTest : public testing::Test {
 protected:
  static constexpr std::uint32_t kTimerHz = 84'000'000;
  void run_us(std::uint64_t microseconds) { timer.run(microseconds * 84); }

  FakeTimer timer;
  FreeRunningClock<FakeTimer> clock{timer};
};

TEST_F(FreeRunningClockTest, Start_CountsMicrosecondsFromZero) {
  clock.start(kTimerHz);
  EXPECT_EQ(clock.now_us(), 0U);
  run_us(1'234);
  EXPECT_EQ(clock.now_us(), 1'234U);
}

TEST_F(FreeRunningClockTest, StalledCore_LosesNoTime) {
  clock.start(kTimerHz);
  run_us(2'000'000);  // the longest erase of a sector: no interrupt, no instruction
  EXPECT_EQ(clock.now_us(), 2'000'000U);
}

TEST_F(FreeRunningClockTest, CounterOverflow_TimeContinuesBeyond32Bits) {
  clock.start(kTimerHz);
  std::uint64_t expected_us = 0;
  for (int hour = 0; hour < 3; ++hour) {
    run_us(3'600'000'000);
    expected_us += 3'600'000'000;
    EXPECT_EQ(clock.now_us(), expected_us);
  }
}

}  // namespace
}  // namespace armtrue::stm32f405
