// What drives receive after their bus took no frames: no old command, no step of the correction.
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>
#include <iterator>
#include <vector>

#include "firmware/ports/stm32f405/bxcan.h"
#include "firmware/ports/stm32f405/fake_bxcan.h"
#include "firmware/testing/driver_bench.h"
#include "firmware/testing/test_table.h"

namespace armtrue::stm32f405 {
namespace {

using canopen::CanFrame;
using canopen::DriverBench;
using canopen::make_frame;

class StaleCommandsTest : public testing::Test {
 protected:
  explicit StaleCommandsTest(const std::vector<std::uint8_t>& image = {}) : bench_(port_, image) {
    take_all();
  }

  // The bus takes all that waits; steps_ is the largest step of joint 1's target on the way.
  void take_all() {
    registers_.sent.clear();
    while (registers_.transmit_one()) port_.on_transmit_interrupt();
    for (const FakeBxCan::Mailbox& frame : registers_.sent) {
      if (frame.identifier >> 21 != DriverBench::kFirstTargets) continue;
      const auto target = static_cast<std::int32_t>(frame.data_low);
      largest_step_ = std::max(largest_step_, std::abs(target - held_));
      held_ = target;
    }
  }
  void lose_acknowledgement() {
    registers_.set_error_status(bxcan::kEsrPassive | bxcan::kEsrWarning);
  }

  static BxCan<FakeBxCan>& started(BxCan<FakeBxCan>& port) {
    EXPECT_TRUE(port.start(ports::bit_timing(42'000'000, 1'000'000)));
    return port;
  }

  FakeBxCan registers_;
  BxCan<FakeBxCan> driver_{registers_};
  BxCan<FakeBxCan>& port_ = started(driver_);
  DriverBench bench_;
  std::int32_t held_ = 0;
  std::int32_t largest_step_ = 0;
};

TEST_F(StaleCommandsTest, BusWithoutAcknowledgement_SendsNoOldTargetOnItsReturn) {
  constexpr std::int32_t kPerCycle = 100;
  std::int32_t target = 100'000;
  for (int k = 0; k < 100; ++k, target += kPerCycle) {
    bench_.cycle(target);
    take_all();
  }
  lose_acknowledgement();
  for (int k = 0; k < 5000; ++k, target += kPerCycle) bench_.cycle(target);
  registers_.set_error_status(0);
  take_all();
  for (const FakeBxCan::Mailbox& frame : registers_.sent) {
    if (frame.identifier >> 21 < DriverBench::kFirstTargets) continue;
    EXPECT_LE((target - static_cast<std::int32_t>(frame.data_low)) / kPerCycle, 21)
        << "cycles, a millisecond each";
  }
  const auto targets = std::count_if(
      registers_.sent.begin(), registers_.sent.end(),
      [](const FakeBxCan::Mailbox& frame) { return frame.identifier >> 21 != DriverBench::kSync; });
  EXPECT_LE(targets, 3) << "one set";
  EXPECT_LE(registers_.sent.size(), 3U + 21U) << "a set, and one SYNC a millisecond";
  const std::uint32_t sets = bench_.counters().sets;
  for (int k = 0; k < 10; ++k, target += kPerCycle) {
    bench_.cycle(target);
    take_all();
  }
  EXPECT_GE(bench_.counters().sets, sets + 9) << "the stream goes on";
}

TEST_F(StaleCommandsTest, BusThatIsBusyForLessThanTheLimit_LosesNothing) {
  constexpr int kHeldUpMs = 8;  // of four frames each: the queue is almost full
  constexpr int kBusy = 20;
  for (int k = 0; k < 10; ++k) {
    bench_.cycle(100'000);
    take_all();
  }
  std::size_t taken = 0;
  for (int busy = 0; busy < kBusy; ++busy) {
    for (int k = 0; k < kHeldUpMs; ++k) bench_.cycle(100'000);
    take_all();
    taken += registers_.sent.size();
  }
  EXPECT_EQ(taken, 4U * kHeldUpMs * kBusy);
  EXPECT_EQ(bench_.counters().output_refused, 0U);
}

TEST_F(StaleCommandsTest, ServicesForTheDrives_LeaveHoweverOld) {
  lose_acknowledgement();
  constexpr std::uint32_t kServices[] = {0x000, 0x081, 0x0FF, 0x581, 0x601, 0x67F, 0x701, 0x7E5};
  constexpr std::uint32_t kCommands[] = {0x080, 0x100, 0x180, 0x201, 0x57F, 0x680, 0x6FF};
  for (const std::uint32_t id : kServices) bench_.deliver(make_frame(id, {2, 0x7F}));
  for (const std::uint32_t id : kCommands) bench_.deliver(make_frame(id, {2, 0x7F}));
  CanFrame extended = make_frame(0x123, {1});
  extended.flags = canopen::kFrameExtended;
  bench_.deliver(extended);
  for (int k = 0; k < 5000; ++k) {
    bench_.now_us += 1000;
    bench_.turn();
  }
  take_all();
  std::vector<std::uint32_t> identifiers;
  for (const FakeBxCan::Mailbox& frame : registers_.sent) {
    identifiers.push_back(frame.identifier >> 21);
  }
  EXPECT_EQ(identifiers, std::vector<std::uint32_t>(std::begin(kServices), std::end(kServices)));
}

TEST_F(StaleCommandsTest, BusWithoutAcknowledgement_IsReported) {
  constexpr std::uint32_t kEmcyId = 0x80 + 0x20;
  for (int k = 0; k < 10; ++k) {
    bench_.cycle(100'000);
    take_all();
  }
  bench_.upstream.take_sent();
  lose_acknowledgement();
  for (int k = 0; k < 1000; ++k) bench_.cycle(100'000);
  std::vector<std::uint32_t> codes;
  for (const CanFrame& frame : bench_.upstream.take_sent()) {
    if (frame.id == kEmcyId) codes.push_back(canopen::load_le<std::uint16_t>(frame.data));
  }
  EXPECT_EQ(codes, (std::vector<std::uint32_t>{0x8120, 0xFF10, 0xFF15}))
      << "passive, no set, withheld; each once";
}

class StaleCorrectionsTest : public StaleCommandsTest {
 protected:
  StaleCorrectionsTest()
      : StaleCommandsTest(
            canopen::TestTable{.amplitude = 1 << 28, .rate = 1 << 24, .blend_ms = 20}.image()) {}

  void rest(int cycles) {
    for (int k = 0; k < cycles; ++k) {
      bench_.cycle(100'000);
      take_all();
    }
  }
  // Returns the largest step in a cycle while the correction blends in.
  std::int32_t begin() {
    rest(2);
    largest_step_ = 0;
    rest(200);
    return largest_step_;
  }
};

TEST_F(StaleCorrectionsTest, FramesDiscardedAtBusOff_DoNotCountAsReceived) {
  const std::int32_t usual = begin();
  ASSERT_GT(usual, 0);
  for (int k = 0; k < 10; ++k) bench_.cycle(100'000);
  registers_.set_error_status(bxcan::kEsrBusOff);
  port_.on_status_interrupt();
  for (int k = 0; k < 200; ++k) bench_.cycle(100'000);
  registers_.set_error_status(0);
  for (int k = 0; k < 5; ++k) {
    bench_.now_us += 1000;
    bench_.turn();
  }
  largest_step_ = 0;
  rest(100);
  EXPECT_LE(largest_step_, usual);
}

TEST_F(StaleCorrectionsTest, FramesDiscardedForAge_DoNotCountAsReceived) {
  const std::int32_t usual = begin();
  for (int stop_ms = 1; stop_ms < 60; stop_ms += 7) {
    lose_acknowledgement();
    for (int k = 0; k < stop_ms; ++k) bench_.cycle(100'000);
    registers_.set_error_status(0);
    largest_step_ = 0;
    rest(20);
    EXPECT_LE(largest_step_, usual) << stop_ms;
  }
}

}  // namespace
}  // namespace armtrue::stm32f405
