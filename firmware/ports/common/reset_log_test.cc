#include "firmware/ports/common/reset_log.h"

#include <gtest/gtest.h>

#include <cstring>

namespace armtrue::ports {
namespace {

class ResetLogTest : public testing::Test {
 protected:
  ResetLogTest() { std::memset(&record_, 0xA5, sizeof record_); }

  // A restart on the same memory.
  ResetLog started(ResetCause hardware) {
    ResetLog log(record_);
    log.start(hardware);
    return log;
  }

  ResetRecord record_;
};

TEST_F(ResetLogTest, UnwrittenMemory_CauseIsThatOfTheHardware) {
  const ResetLog log = started(ResetCause::kPin);
  EXPECT_EQ(log.cause(), ResetCause::kPin);
  EXPECT_EQ(log.resets(), 1U);
  EXPECT_EQ(log.history(), 3U);
  EXPECT_EQ(log.fault().instruction, 0U);
}

TEST_F(ResetLogTest, NotedCause_IsReportedAfterOneReset) {
  started(ResetCause::kPowerOn).note(ResetCause::kNmt);
  EXPECT_EQ(started(ResetCause::kSoftware).cause(), ResetCause::kNmt);
  EXPECT_EQ(started(ResetCause::kSoftware).cause(), ResetCause::kSoftware) << "noted once";
}

TEST_F(ResetLogTest, FaultPlace_IsKeptUntilPowerOn) {
  const FaultPlace place{.instruction = 0x08001234, .status = 0x82, .address = 4};
  started(ResetCause::kPowerOn).note(ResetCause::kMemoryFault, &place);
  EXPECT_EQ(started(ResetCause::kSoftware).cause(), ResetCause::kMemoryFault);
  const ResetLog later = started(ResetCause::kPin);
  EXPECT_EQ(later.cause(), ResetCause::kPin);
  EXPECT_EQ(later.fault().instruction, 0x08001234U);
  EXPECT_EQ(later.fault().address, 4U);
  EXPECT_EQ(started(ResetCause::kPowerOn).fault().instruction, 0U);
}

TEST_F(ResetLogTest, WatchdogResetAfterAFault_ReportsTheFault) {
  started(ResetCause::kPowerOn).note(ResetCause::kFault);
  EXPECT_EQ(started(ResetCause::kWatchdog).cause(), ResetCause::kFault);
  EXPECT_EQ(started(ResetCause::kWatchdog).cause(), ResetCause::kWatchdog);
}

TEST_F(ResetLogTest, BrownOutAfterANote_ReportsTheBrownOut) {
  started(ResetCause::kPowerOn).note(ResetCause::kNmt);
  EXPECT_EQ(started(ResetCause::kBrownOut).cause(), ResetCause::kBrownOut);
}

TEST_F(ResetLogTest, History_HoldsTheLastEightCauses) {
  started(ResetCause::kPowerOn);
  for (int k = 0; k < 7; ++k) started(ResetCause::kWatchdog);
  EXPECT_EQ(started(ResetCause::kPin).history(), 0x44444443U);
  EXPECT_EQ(started(ResetCause::kPin).resets(), 10U);
}

TEST_F(ResetLogTest, DamagedRecord_IsDiscarded) {
  started(ResetCause::kPowerOn).note(ResetCause::kNmt);
  record_.noted ^= 1U;
  const ResetLog log = started(ResetCause::kSoftware);
  EXPECT_EQ(log.cause(), ResetCause::kSoftware);
  EXPECT_EQ(log.resets(), 1U);
}

}  // namespace
}  // namespace armtrue::ports
