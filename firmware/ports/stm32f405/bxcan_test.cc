#include "firmware/ports/stm32f405/bxcan.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>
#include <iterator>
#include <vector>

#include "firmware/ports/stm32f405/fake_bxcan.h"
#include "firmware/testing/driver_bench.h"
#include "firmware/testing/simulated_port.h"
#include "firmware/testing/test_table.h"

namespace armtrue::stm32f405 {
namespace {

using canopen::BusState;
using canopen::CanFrame;
using canopen::counting_frame;
using canopen::DriverBench;
using canopen::make_frame;

constexpr ports::BitTiming kTiming = ports::bit_timing(42'000'000, 1'000'000);

class BxCanTest : public testing::Test {
 protected:
  void SetUp() override { ASSERT_TRUE(can_.start(kTiming)); }

  // Runs the hardware and its transmit interrupt until nothing is left to send.
  void drain() {
    while (fake_.transmit_one()) can_.on_transmit_interrupt();
  }

  FakeBxCan fake_;
  BxCan<FakeBxCan> can_{fake_};
};

TEST_F(BxCanTest, StartSetsTheTimingAndLeavesInitialisation) {
  const std::uint32_t timing = fake_.read(bxcan::kBtr);
  const std::uint32_t quanta = 1 + ((timing >> 16 & 0xF) + 1) + ((timing >> 20 & 0x7) + 1);
  EXPECT_EQ(42'000'000 / ((timing & 0x3FF) + 1) / quanta, 1'000'000U);
  EXPECT_EQ(timing >> 30, 0U) << "neither loop-back nor silent";
  EXPECT_EQ(fake_.read(bxcan::kMcr), bxcan::kMcrTxfp);
  EXPECT_EQ(can_.bus_state(), BusState::kActive);
}

TEST(BxCanStart, Start_WithoutAController_Fails) {
  FakeBxCan fake;
  fake.is_present = false;
  BxCan<FakeBxCan> can(fake);
  EXPECT_FALSE(can.start(kTiming));
}

TEST(BxCanStart, Start_WithoutAValidTiming_Fails) {
  FakeBxCan fake;
  BxCan<FakeBxCan> can(fake);
  EXPECT_FALSE(can.start({}));
}

TEST(BxCanFilters, LetEverythingThroughOnBothControllers) {
  FakeBxCan fake;
  accept_all_frames(fake);
  EXPECT_EQ(fake.read(bxcan::kFmr), 14U << 8) << "CAN2 begins at bank 14, initialisation is over";
  EXPECT_EQ(fake.read(bxcan::kFa1r), (1U << 0) | (1U << 14));
  EXPECT_EQ(fake.read(bxcan::kFfa1r), 0U);
}

TEST_F(BxCanTest, HasBacklog_OnlyIfTheMailboxesAreFull) {
  for (int k = 0; k < 3; ++k) ASSERT_TRUE(can_.send(counting_frame(0x123, 0x10)));
  EXPECT_FALSE(can_.has_backlog());
  ASSERT_TRUE(can_.send(counting_frame(0x123, 0x10)));
  EXPECT_TRUE(can_.has_backlog());
  drain();
  EXPECT_FALSE(can_.has_backlog());
}

TEST_F(BxCanTest, SendsTheFrameBitForBit) {
  ASSERT_TRUE(can_.send(counting_frame(0x123, 0x10)));
  CanFrame extended = counting_frame(0x1ABCDEF0, 0x20, 3);
  extended.flags = canopen::kFrameExtended;
  ASSERT_TRUE(can_.send(extended));
  CanFrame remote = counting_frame(0x7FF, 0, 0);
  remote.flags = canopen::kFrameRemote;
  ASSERT_TRUE(can_.send(remote));
  drain();
  ASSERT_EQ(fake_.sent.size(), 3U);
  EXPECT_EQ(fake_.sent[0].identifier, 0x123U << 21 | bxcan::kIdRequest);
  EXPECT_EQ(fake_.sent[0].length, 8U);
  EXPECT_EQ(fake_.sent[0].data_low, 0x13121110U);
  EXPECT_EQ(fake_.sent[0].data_high, 0x17161514U);
  EXPECT_EQ(fake_.sent[1].identifier, 0x1ABCDEF0U << 3 | bxcan::kIdExtended | bxcan::kIdRequest);
  EXPECT_EQ(fake_.sent[1].length, 3U);
  EXPECT_EQ(fake_.sent[1].data_low, 0x00222120U);
  EXPECT_EQ(fake_.sent[2].identifier, 0x7FFU << 21 | bxcan::kIdRemote | bxcan::kIdRequest);
  EXPECT_EQ(can_.counters().sent, 3U);
}

TEST_F(BxCanTest, FramesLeaveInTheOrderInWhichTheyWereQueued) {
  constexpr std::uint8_t kFrames = 40;
  for (std::uint8_t i = 0; i < kFrames; ++i) {
    ASSERT_TRUE(can_.send(counting_frame(0x700U - i, i)));
    if (i % 7 == 0) fake_.transmit_one();
    if (i % 5 == 0) can_.on_transmit_interrupt();
  }
  drain();
  ASSERT_EQ(fake_.sent.size(), kFrames);
  for (std::uint8_t i = 0; i < kFrames; ++i) EXPECT_EQ(fake_.sent[i].data_low & 0xFF, i);
}

TEST_F(BxCanTest, FullQueue_RefusesFramesUntilOneIsSent) {
  const std::size_t places = BxCan<FakeBxCan>::kQueue + bxcan::kMailboxes;
  for (std::size_t i = 0; i < places; ++i) ASSERT_TRUE(can_.send(counting_frame(0x100, 0)));
  EXPECT_FALSE(can_.send(counting_frame(0x100, 0)));
  EXPECT_EQ(can_.counters().send_refused, 1U);
  ASSERT_TRUE(fake_.transmit_one());
  can_.on_transmit_interrupt();
  EXPECT_TRUE(can_.send(counting_frame(0x100, 0)));
  drain();
  EXPECT_EQ(can_.counters().sent, places + 1);
}

TEST_F(BxCanTest, FrameThatIsNotClassicCan_IsRefused) {
  CanFrame fd = counting_frame(0x100, 0);
  fd.flags = canopen::kFrameFd;
  EXPECT_FALSE(can_.send(fd));
  CanFrame long_frame = counting_frame(0x100, 0);
  long_frame.len = 9;
  EXPECT_FALSE(can_.send(long_frame));
  EXPECT_FALSE(can_.send(counting_frame(0x800, 0)));
  EXPECT_EQ(can_.counters().send_refused, 3U);
  EXPECT_EQ(fake_.requested(), 0U);
}

TEST_F(BxCanTest, DiscardCommands_LeavesOtherFramesInTheirOrder) {
  for (std::uint8_t i = 0; i < 12; ++i) {
    const CanFrame frame = counting_frame(0x100U + i, i);
    const bool is_command = i % 4 != 1;
    const auto axes = static_cast<std::uint8_t>(i < 6 ? 0x03 : 0x0C);
    ASSERT_TRUE(is_command ? can_.send_command(frame, {axes, static_cast<std::uint8_t>(250 + i)})
                           : can_.send(frame));
  }
  ASSERT_TRUE(fake_.transmit_one());
  canopen::Discarded discarded;
  can_.discard_commands(discarded);
  EXPECT_EQ(discarded.axes, 0x0F);
  EXPECT_EQ(discarded.cycle[0], 252) << "the oldest that has not left; 250 has";
  EXPECT_EQ(discarded.cycle[2], 0) << "256";
  EXPECT_EQ(can_.commands().accepted, 9U);
  EXPECT_EQ(can_.commands().gone, 9U);
  EXPECT_EQ(can_.counters().send_refused, 8U);
  can_.on_transmit_interrupt();
  drain();
  ASSERT_EQ(fake_.sent.size(), 4U);
  for (const std::size_t k : {1U, 2U, 3U}) EXPECT_EQ(fake_.sent[k].data_low & 0xFF, 4 * k - 3);
  EXPECT_EQ(can_.commands().gone, 9U);
}

TEST_F(BxCanTest, DiscardCommands_WithoutOne_AbortsNothing) {
  for (int k = 0; k < 5; ++k) ASSERT_TRUE(can_.send(counting_frame(0x5A0, 0)));
  canopen::Discarded discarded;
  can_.discard_commands(discarded);
  EXPECT_EQ(discarded.axes, 0);
  drain();
  EXPECT_EQ(fake_.sent.size(), 5U);
}

TEST_F(BxCanTest, CompletionBeforeItsInterrupt_IsCountedByTheNextFrame) {
  ASSERT_TRUE(can_.send_command(counting_frame(0x200, 0), {}));
  ASSERT_TRUE(fake_.transmit_one());
  ASSERT_TRUE(can_.send_command(counting_frame(0x200, 1), {}));
  EXPECT_EQ(can_.commands().gone, 1U);
  EXPECT_EQ(can_.counters().sent, 1U);
}

TEST_F(BxCanTest, ReceivesEveryKindOfFrame) {
  fake_.deliver({0x7FFU << 21, 8, 0x03020100, 0x07060504});
  fake_.deliver({0x1FFFFFFFU << 3 | bxcan::kIdExtended, 2, 0xBBAA, 0});
  fake_.deliver({0x001U << 21 | bxcan::kIdRemote, 0, 0, 0});
  can_.on_receive_interrupt();
  CanFrame frame;
  ASSERT_TRUE(can_.receive(frame));
  EXPECT_EQ(frame.id, 0x7FFU);
  EXPECT_EQ(frame.flags, canopen::kFrameNone);
  ASSERT_EQ(frame.len, 8);
  for (std::uint8_t i = 0; i < 8; ++i) EXPECT_EQ(frame.data[i], i);
  ASSERT_TRUE(can_.receive(frame));
  EXPECT_EQ(frame.id, 0x1FFFFFFFU);
  EXPECT_EQ(frame.flags, canopen::kFrameExtended);
  EXPECT_EQ(frame.len, 2);
  ASSERT_TRUE(can_.receive(frame));
  EXPECT_TRUE(frame.is(canopen::kFrameRemote));
  EXPECT_FALSE(can_.receive(frame));
  EXPECT_EQ(can_.counters().received, 3U);
}

TEST_F(BxCanTest, LengthCodeAboveEight_MeansEight) {
  fake_.deliver({0x100U << 21, 15, 0, 0});
  can_.on_receive_interrupt();
  CanFrame frame;
  ASSERT_TRUE(can_.receive(frame));
  EXPECT_EQ(frame.len, 8);
}

TEST_F(BxCanTest, FramesLostByTheHardware_CountAsOneOverrun) {
  for (int i = 0; i < 5; ++i) fake_.deliver({0x100U << 21, 1, 0, 0});
  can_.on_receive_interrupt();
  EXPECT_EQ(can_.counters().received, 3U);
  EXPECT_EQ(can_.counters().receive_overruns, 1U)
      << "bxCAN tells that frames were lost, not how many";
  fake_.deliver({0x100U << 21, 1, 0, 0});
  can_.on_receive_interrupt();
  EXPECT_EQ(can_.counters().receive_overruns, 1U);
}

TEST_F(BxCanTest, FramesBeyondTheReceiveQueue_AreCounted) {
  for (std::size_t i = 0; i < BxCan<FakeBxCan>::kQueue + 4; ++i) {
    fake_.deliver({0x100U << 21, 1, static_cast<std::uint32_t>(i), 0});
    can_.on_receive_interrupt();
  }
  EXPECT_EQ(can_.counters().receive_overruns, 4U);
  CanFrame frame;
  std::uint8_t expected = 0;
  while (can_.receive(frame)) EXPECT_EQ(frame.data[0], expected++);
  EXPECT_EQ(expected, BxCan<FakeBxCan>::kQueue) << "the oldest are kept";
}

TEST_F(BxCanTest, ReportsTheErrorState) {
  fake_.set_error_status(bxcan::kEsrWarning);
  EXPECT_EQ(can_.bus_state(), BusState::kWarning);
  fake_.set_error_status(bxcan::kEsrWarning | bxcan::kEsrPassive);
  EXPECT_EQ(can_.bus_state(), BusState::kPassive);
  fake_.set_error_status(0);
  EXPECT_EQ(can_.bus_state(), BusState::kActive);
}

class BxCanBusOffTest : public BxCanTest {
 protected:
  void SetUp() override {
    BxCanTest::SetUp();
    for (int i = 0; i < 10; ++i) ASSERT_TRUE(can_.send(counting_frame(0x200, 0)));
    fake_.set_error_status(bxcan::kEsrWarning | bxcan::kEsrPassive | bxcan::kEsrBusOff);
    can_.on_status_interrupt();
  }
};

TEST_F(BxCanBusOffTest, IsReportedAndCountedOnce) {
  EXPECT_EQ(can_.bus_state(), BusState::kBusOff);
  can_.on_status_interrupt();
  EXPECT_EQ(can_.bus_state(), BusState::kBusOff);
  EXPECT_EQ(can_.counters().bus_off_entries, 1U);
}

TEST_F(BxCanBusOffTest, RefusesFrames_DoesNotRecoverByItself) {
  EXPECT_FALSE(can_.send(counting_frame(0x200, 0)));
  EXPECT_EQ(can_.counters().send_refused, 1U);
  for (int i = 0; i < 100; ++i) EXPECT_EQ(can_.bus_state(), BusState::kBusOff);
  EXPECT_FALSE(fake_.is_initialising());
}

TEST_F(BxCanBusOffTest, Recovery_RunsInitialisation_DiscardsTheQueue) {
  can_.recover();
  EXPECT_EQ(fake_.requested(), 0U);
  while (!fake_.is_initialising()) EXPECT_EQ(can_.bus_state(), BusState::kBusOff);
  for (int i = 0; i < 10; ++i)
    EXPECT_EQ(can_.bus_state(), BusState::kBusOff) << "recessive bits run";
  EXPECT_FALSE(fake_.is_initialising());
  EXPECT_FALSE(can_.send(counting_frame(0x200, 0)));

  fake_.set_error_status(0);
  EXPECT_EQ(can_.bus_state(), BusState::kActive);
  ASSERT_TRUE(can_.send(counting_frame(0x201, 0x55)));
  drain();
  ASSERT_EQ(fake_.sent.size(), 1U);
  EXPECT_EQ(fake_.sent[0].identifier, 0x201U << 21 | bxcan::kIdRequest);
}

TEST_F(BxCanBusOffTest, SecondBusOff_IsCountedAndRecovers) {
  can_.recover();
  fake_.set_error_status(0);
  while (can_.bus_state() == BusState::kBusOff) {
  }
  fake_.set_error_status(bxcan::kEsrBusOff);
  EXPECT_EQ(can_.bus_state(), BusState::kBusOff);
  EXPECT_EQ(can_.counters().bus_off_entries, 2U);
  can_.recover();
  fake_.set_error_status(0);
  for (int i = 0; i < 10; ++i) can_.bus_state();
  EXPECT_EQ(can_.bus_state(), BusState::kActive);
}

TEST_F(BxCanTest, RecoveryWithoutBusOffHasNoEffect) {
  ASSERT_TRUE(can_.send(counting_frame(0x200, 1)));
  can_.recover();
  EXPECT_EQ(can_.bus_state(), BusState::kActive);
  EXPECT_EQ(fake_.requested(), 1U);
}

TEST_F(BxCanTest, AnAbortedMailboxIsNotCountedAsSent) {
  ASSERT_TRUE(can_.send(counting_frame(0x200, 1)));
  fake_.transmit_one(false);
  can_.on_transmit_interrupt();
  EXPECT_EQ(can_.counters().sent, 0U);
}

// What drives receive after their bus took no frames: no old command, no step of the correction.
class StaleCommandsTest : public testing::Test {
 protected:
  explicit StaleCommandsTest(const std::vector<std::uint8_t>& image = {}) : bench_(port_, image) {
    take_all();
  }

  // The bus sends all queued frames; steps_ is the largest step of joint 1's target among them.
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

TEST_F(StaleCommandsTest, ServiceFrames_AreSentAtAnyAge) {
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
