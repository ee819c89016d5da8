#include "firmware/ports/r5f/zynqmp_can.h"

#include <gtest/gtest.h>

#include "firmware/ports/r5f/fake_zynqmp_can.h"
#include "firmware/testing/driver_bench.h"
#include "firmware/testing/simulated_port.h"

namespace armtrue::r5f {
namespace {

using canopen::BusState;
using canopen::CanFrame;
using canopen::counting_frame;

constexpr ports::BitTiming kTiming = ports::bit_timing(100'000'000, 1'000'000);

ports::ClassicFrame classic(std::uint32_t id, std::uint8_t flags, std::uint8_t len) {
  ports::ClassicFrame frame{id, flags, len, {}};
  for (std::uint8_t i = 0; i < len; ++i) frame.data[i] = static_cast<std::uint8_t>(0x10 + i);
  return frame;
}

TEST(FifoLayoutTest, HardwareLayout_IsThatOfTheManual) {
  const FifoWords base = to_fifo(classic(0x555, 0, 8), FifoLayout::kHardware);
  EXPECT_EQ(base.id, 0x555U << 21);
  EXPECT_EQ(base.dlc, 8U << 28);
  EXPECT_EQ(base.data1, 0x10111213U);
  EXPECT_EQ(base.data2, 0x14151617U);
  const FifoWords remote = to_fifo(classic(0x001, canopen::kFrameRemote, 0), FifoLayout::kHardware);
  EXPECT_EQ(remote.id, 1U << 21 | 1U << 20);
  // Top eleven bits, substitute remote, extended, lower eighteen bits.
  const FifoWords extended =
      to_fifo(classic(0x15555555, canopen::kFrameExtended, 1), FifoLayout::kHardware);
  EXPECT_EQ(extended.id,
            (0x15555555U >> 18) << 21 | 1U << 20 | 1U << 19 | (0x15555555U & 0x3FFFF) << 1);
}

TEST(FifoLayoutTest, EmulatedLayout_IsThatOfSocketCan) {
  const FifoWords base = to_fifo(classic(0x555, 0, 8), FifoLayout::kEmulated);
  EXPECT_EQ(base.id, 0x555U);
  EXPECT_EQ(base.data1, 0x13121110U);
  EXPECT_EQ(to_fifo(classic(0x1FFFFFFF, canopen::kFrameExtended, 1), FifoLayout::kEmulated).id,
            0x9FFFFFFFU);
  EXPECT_EQ(to_fifo(classic(0x7FF, canopen::kFrameRemote, 1), FifoLayout::kEmulated).id,
            0x400007FFU);
}

TEST(FifoLayoutTest, EveryFrame_SurvivesTheRoundTrip) {
  for (const FifoLayout layout : {FifoLayout::kHardware, FifoLayout::kEmulated}) {
    for (std::uint32_t i = 0; i < 4000; ++i) {
      const bool extended = i % 2 != 0;
      const auto flags = static_cast<std::uint8_t>((extended ? canopen::kFrameExtended : 0) |
                                                   (i % 5 == 0 ? canopen::kFrameRemote : 0));
      const ports::ClassicFrame sent = classic(i * 2654435761U & (extended ? 0x1FFFFFFFU : 0x7FFU),
                                               flags, static_cast<std::uint8_t>(i % 9));
      const ports::ClassicFrame got = from_fifo(to_fifo(sent, layout), layout);
      ASSERT_EQ(got.id, sent.id);
      ASSERT_EQ(got.flags, sent.flags);
      ASSERT_EQ(got.len, sent.len);
      ASSERT_EQ(got.data, sent.data);
    }
  }
}

TEST(FifoLayoutTest, LengthCodeAboveEight_MeansEight) {
  EXPECT_EQ(from_fifo({0, 15U << 28, 0, 0}, FifoLayout::kHardware).len, 8);
}

class ZynqMpCanTest : public testing::Test {
 protected:
  void SetUp() override { ASSERT_TRUE(can_.start(kTiming)); }

  void run_interrupts() {
    while (fake_.is_requesting()) can_.on_interrupt();
  }

  // Runs the hardware and its interrupt until nothing is left to send.
  void drain() {
    while (fake_.transmit_one()) run_interrupts();
  }

  static FifoWords words_of(std::uint32_t id, std::uint32_t data1 = 0) {
    return {id << 21, 4U << 28, data1, 0};
  }

  FakeZynqMpCan fake_;
  ZynqMpCan<FakeZynqMpCan> can_{fake_, FifoLayout::kHardware};
};

TEST_F(ZynqMpCanTest, Start_SetsTheTimingAndJoinsTheBus) {
  const std::uint32_t timing = fake_.read(zynqmp_can::kBtr);
  const std::uint32_t quanta = 1 + ((timing & 0xF) + 1) + ((timing >> 4 & 7) + 1);
  EXPECT_EQ(100'000'000 / (fake_.read(zynqmp_can::kBrpr) + 1) / quanta, 1'000'000U);
  EXPECT_TRUE(fake_.is_enabled());
  EXPECT_EQ(fake_.read(zynqmp_can::kMsr), 0U) << "neither loop-back, sleep nor snoop";
  EXPECT_EQ(can_.bus_state(), BusState::kActive);
}

TEST(ZynqMpCanStart, Start_WithoutAController_Fails) {
  FakeZynqMpCan fake;
  fake.is_present = false;
  ZynqMpCan<FakeZynqMpCan> can(fake, FifoLayout::kHardware);
  EXPECT_FALSE(can.start(kTiming));
  EXPECT_FALSE(can.start({}));
}

TEST_F(ZynqMpCanTest, FramesLeaveInTheOrderInWhichTheyWereQueued) {
  for (std::uint8_t i = 0; i < 50; ++i) ASSERT_TRUE(can_.send(counting_frame(0x700U - i, i)));
  drain();
  ASSERT_EQ(fake_.sent.size(), 50U);
  for (std::uint8_t i = 0; i < 50; ++i) EXPECT_EQ(fake_.sent[i].data1 >> 24, i);
  EXPECT_EQ(can_.counters().sent, 50U);
}

TEST_F(ZynqMpCanTest, FullQueue_RefusesFramesUntilOneIsSent) {
  for (std::size_t i = 0; i < FakeZynqMpCan::kFifo; ++i)
    ASSERT_TRUE(can_.send(counting_frame(0x100, 0)));
  EXPECT_FALSE(can_.send(counting_frame(0x100, 0)));
  EXPECT_EQ(can_.counters().send_refused, 1U);
  ASSERT_TRUE(fake_.transmit_one());
  EXPECT_TRUE(can_.send(counting_frame(0x100, 0)));
}

TEST_F(ZynqMpCanTest, FrameThatIsNotClassicCan_IsRefused) {
  CanFrame fd = counting_frame(0x100, 0);
  fd.flags = canopen::kFrameFd;
  EXPECT_FALSE(can_.send(fd));
  EXPECT_FALSE(can_.send(counting_frame(0x800, 0)));
  EXPECT_EQ(can_.counters().send_refused, 2U);
  EXPECT_FALSE(fake_.transmit_one());
}

TEST_F(ZynqMpCanTest, DiscardCommands_TakesTheOldestBackFromTheController) {
  ASSERT_TRUE(can_.send_command(counting_frame(0x220, 1), {0x01, 7}));
  ASSERT_TRUE(can_.send(counting_frame(0x5A0, 2)));
  ASSERT_TRUE(can_.send_command(counting_frame(0x220, 3), {0x01, 8}));
  fake_.set_error_state(zynqmp_can::kSrPassive);
  fake_.deliver(words_of(0x123));
  canopen::Discarded discarded;
  can_.discard_commands(discarded);
  EXPECT_EQ(discarded.axes, 0x01);
  EXPECT_EQ(discarded.cycle[0], 7);
  EXPECT_EQ(can_.commands().gone, 2U);
  EXPECT_EQ(can_.counters().send_refused, 2U);
  CanFrame frame;
  EXPECT_TRUE(can_.receive(frame)) << "arrived before the reset";
  can_.bus_state();
  drain();
  ASSERT_EQ(fake_.sent.size(), 1U);
  EXPECT_EQ(fake_.sent[0].id, 0x5A0U << 21);
}

TEST_F(ZynqMpCanTest, DiscardCommands_StaysPassiveUntilAFrameLeaves) {
  ASSERT_TRUE(can_.send_command(counting_frame(0x220, 1), {}));
  fake_.set_error_state(zynqmp_can::kSrPassive);
  canopen::Discarded discarded;
  can_.discard_commands(discarded);
  EXPECT_EQ(can_.bus_state(), BusState::kPassive) << "the reset has cleared the error counters";
  ASSERT_TRUE(can_.send(counting_frame(0x5A0, 2)));
  EXPECT_EQ(can_.bus_state(), BusState::kPassive);
  drain();
  EXPECT_EQ(can_.bus_state(), BusState::kActive);
}

TEST_F(ZynqMpCanTest, DiscardCommands_BehindAnotherFrame_ResetsNothing) {
  ASSERT_TRUE(can_.send(counting_frame(0x5A0, 2)));
  ASSERT_TRUE(can_.send_command(counting_frame(0x220, 1), {}));
  fake_.set_error_state(zynqmp_can::kSrWarning);
  canopen::Discarded discarded;
  can_.discard_commands(discarded);
  EXPECT_EQ(can_.commands().gone, 1U);
  EXPECT_EQ(can_.bus_state(), BusState::kWarning) << "a reset would clear it";
  drain();
  EXPECT_EQ(fake_.sent.size(), 1U);
}

TEST_F(ZynqMpCanTest, DiscardCommands_OnADominantBus_SendsTheRestWhenItIsFree) {
  ASSERT_TRUE(can_.send_command(counting_frame(0x220, 1), {}));
  ASSERT_TRUE(can_.send(counting_frame(0x5A0, 2)));
  fake_.is_bus_dominant = true;
  canopen::Discarded discarded;
  can_.discard_commands(discarded);
  can_.bus_state();
  EXPECT_FALSE(fake_.transmit_one());
  fake_.is_bus_dominant = false;
  can_.bus_state();
  drain();
  ASSERT_EQ(fake_.sent.size(), 1U);
  EXPECT_EQ(fake_.sent[0].id, 0x5A0U << 21);
}

TEST_F(ZynqMpCanTest, CommandThatHasLeft_IsNotDiscarded) {
  ASSERT_TRUE(can_.send_command(counting_frame(0x220, 1), {0x01, 7}));
  ASSERT_TRUE(fake_.transmit_one());
  canopen::Discarded discarded;
  can_.discard_commands(discarded);
  EXPECT_EQ(discarded.axes, 0);
  EXPECT_EQ(can_.commands().gone, 1U);
}

// As on bxCAN (bxcan_test.cc): 5 s without acknowledgement.
TEST_F(ZynqMpCanTest, BusWithoutAcknowledgement_SendsNoOldTargetOnItsReturn) {
  constexpr std::int32_t kPerCycle = 100;
  canopen::DriverBench bench(can_);
  std::int32_t target = 100'000;
  for (int k = 0; k < 100; ++k, target += kPerCycle) {
    bench.cycle(target);
    drain();
  }
  fake_.set_error_state(zynqmp_can::kSrPassive);
  for (int k = 0; k < 5000; ++k, target += kPerCycle) bench.cycle(target);
  fake_.sent.clear();
  drain();
  std::size_t targets = 0;
  for (const FifoWords& words : fake_.sent) {
    const ports::ClassicFrame frame = from_fifo(words, FifoLayout::kHardware);
    if (frame.id == canopen::DriverBench::kSync) continue;
    ++targets;
    const std::int32_t age = target - static_cast<std::int32_t>(frame.words()[0]);
    EXPECT_LE(age / kPerCycle, 21) << "cycles, a millisecond each";
  }
  EXPECT_LE(targets, 3U) << "one set";
  const std::uint32_t sets = bench.counters().sets;
  for (int k = 0; k < 10; ++k, target += kPerCycle) {
    bench.cycle(target);
    drain();
  }
  EXPECT_GE(bench.counters().sets, sets + 9) << "the stream goes on";
}

TEST_F(ZynqMpCanTest, ReceivesInOrder) {
  for (std::uint32_t i = 0; i < 60; ++i) fake_.deliver(words_of(0x100 + i, i << 24));
  run_interrupts();
  CanFrame frame;
  for (std::uint32_t i = 0; i < 60; ++i) {
    ASSERT_TRUE(can_.receive(frame));
    EXPECT_EQ(frame.id, 0x100 + i);
    EXPECT_EQ(frame.len, 4);
    EXPECT_EQ(frame.data[0], i);
  }
  EXPECT_FALSE(can_.receive(frame));
  EXPECT_EQ(can_.counters().received, 60U);
}

TEST(LongestBurstTest, IsShortInTheEmulatorOnly) {
  FakeZynqMpCan fake;
  EXPECT_EQ(ZynqMpCan<FakeZynqMpCan>(fake, FifoLayout::kHardware).longest_burst(), 127);
  EXPECT_LE(ZynqMpCan<FakeZynqMpCan>(fake, FifoLayout::kEmulated).longest_burst(),
            FakeZynqMpCan::kFifo / 2);
}

TEST_F(ZynqMpCanTest, AnInterruptWithoutCauseIsHarmless) {
  can_.on_interrupt();
  CanFrame frame;
  EXPECT_FALSE(can_.receive(frame));
}

TEST_F(ZynqMpCanTest, LostReceivedFrames_AreCounted) {
  for (std::size_t i = 0; i < FakeZynqMpCan::kFifo + 1; ++i) fake_.deliver(words_of(0x100));
  run_interrupts();
  EXPECT_EQ(can_.counters().receive_overruns, 1U) << "by the hardware";
  fake_.deliver(words_of(0x100));
  fake_.deliver(words_of(0x100));
  run_interrupts();
  EXPECT_EQ(can_.counters().receive_overruns, 3U) << "because nobody took them";
  CanFrame frame;
  std::size_t kept = 0;
  while (can_.receive(frame)) ++kept;
  EXPECT_EQ(kept, ZynqMpCan<FakeZynqMpCan>::kQueue);
}

TEST_F(ZynqMpCanTest, ReportsTheErrorState) {
  fake_.set_error_state(1U << 7 | zynqmp_can::kSrWarning);
  EXPECT_EQ(can_.bus_state(), BusState::kWarning);
  fake_.set_error_state(zynqmp_can::kSrPassive);
  EXPECT_EQ(can_.bus_state(), BusState::kPassive);
  fake_.set_error_state(1U << 7);
  EXPECT_EQ(can_.bus_state(), BusState::kActive);
}

TEST_F(ZynqMpCanTest, BusOff_LastsUntilRecovery_DiscardsTheQueue) {
  for (int i = 0; i < 10; ++i) ASSERT_TRUE(can_.send(counting_frame(0x200, 0)));
  fake_.set_error_state(zynqmp_can::kSrBusOff);
  EXPECT_EQ(can_.bus_state(), BusState::kBusOff) << "before the interrupt";
  run_interrupts();
  EXPECT_FALSE(fake_.is_enabled()) << "held in configuration mode";
  EXPECT_EQ(can_.counters().bus_off_entries, 1U);
  fake_.set_error_state(1U << 7);
  EXPECT_EQ(can_.bus_state(), BusState::kBusOff);
  EXPECT_FALSE(can_.send(counting_frame(0x200, 0)));

  can_.recover();
  EXPECT_EQ(can_.bus_state(), BusState::kActive);
  EXPECT_TRUE(fake_.is_enabled());
  ASSERT_TRUE(can_.send(counting_frame(0x201, 0)));
  drain();
  ASSERT_EQ(fake_.sent.size(), 1U);
  EXPECT_EQ(fake_.sent[0].id, 0x201U << 21);
  fake_.deliver(words_of(0x123));
  run_interrupts();
  CanFrame frame;
  EXPECT_TRUE(can_.receive(frame)) << "and receives again";
}

TEST_F(ZynqMpCanTest, BusStillDominantAtRecovery_JoinsWhenItIsFree) {
  fake_.set_error_state(zynqmp_can::kSrBusOff);
  run_interrupts();
  fake_.is_bus_dominant = true;
  can_.recover();
  EXPECT_EQ(can_.bus_state(), BusState::kBusOff);
  EXPECT_FALSE(can_.send(counting_frame(0x200, 0)));
  fake_.is_bus_dominant = false;
  EXPECT_EQ(can_.bus_state(), BusState::kActive);
  EXPECT_TRUE(can_.send(counting_frame(0x200, 0)));
  EXPECT_TRUE(fake_.transmit_one());
}

TEST(ZynqMpCanStart, Start_OnADominantBus_JoinsWhenItIsFree) {
  FakeZynqMpCan fake;
  fake.is_bus_dominant = true;
  ZynqMpCan<FakeZynqMpCan> can(fake, FifoLayout::kHardware);
  EXPECT_TRUE(can.start(kTiming));
  fake.is_bus_dominant = false;
  EXPECT_EQ(can.bus_state(), BusState::kActive);
  EXPECT_TRUE(can.send(counting_frame(0x200, 0)));
  EXPECT_TRUE(fake.transmit_one());
}

TEST_F(ZynqMpCanTest, RecoveryWithoutBusOffHasNoEffect) {
  ASSERT_TRUE(can_.send(counting_frame(0x200, 0)));
  can_.recover();
  EXPECT_TRUE(fake_.transmit_one());
}

TEST_F(ZynqMpCanTest, Recovery_WithoutAController_StaysBusOff) {
  fake_.set_error_state(zynqmp_can::kSrBusOff);
  run_interrupts();
  fake_.is_present = false;
  can_.recover();
  EXPECT_EQ(can_.bus_state(), BusState::kBusOff);
}

}  // namespace
}  // namespace armtrue::r5f
