// Frames that are NMT commands to this node, and heartbeats that are sent or lost.
#include "firmware/canopen/protocol/nmt.h"

#include <gtest/gtest.h>

#include <vector>

#include "firmware/testing/simulated_port.h"

namespace armtrue::canopen {
namespace {

constexpr std::uint8_t kId = 0x20;

class NmtTest : public testing::Test {
 protected:
  NmtTest() : port(false), nmt(kId) { nmt.boot(port, 0); }

  SimulatedPort port;
  Nmt nmt;
};

bool is_defined(int command) {
  return command == 1 || command == 2 || command == 128 || command == 129 || command == 130;
}

TEST_F(NmtTest, Command_NotDefinedByTheStandard_IsIgnored) {
  for (int command = 0; command < 256; ++command) {
    const auto heard = nmt.command_in(make_frame(0, {command, kId}));
    EXPECT_EQ(heard, is_defined(command) ? command : 0);
  }
}

TEST_F(NmtTest, LeavesOperational_ForFourCommandsOnly) {
  for (int command = 0; command < 256; ++command) {
    EXPECT_EQ(Nmt::leaves_operational(static_cast<std::uint8_t>(command)),
              is_defined(command) && command != 1)
        << command;
  }
}

TEST_F(NmtTest, Command_InFdRemoteOrWrongLengthFrame_IsIgnored) {
  CanFrame frame = make_frame(0, {1, kId});
  ASSERT_EQ(nmt.command_in(frame), 1);
  frame.flags = kFrameFd;
  EXPECT_EQ(nmt.command_in(frame), 0);
  frame.flags = kFrameFd | kFrameBitRateSwitch;
  EXPECT_EQ(nmt.command_in(frame), 0);
  frame.flags = kFrameRemote;
  EXPECT_EQ(nmt.command_in(frame), 0);
  EXPECT_EQ(nmt.command_in(make_frame(0, {1, kId, 0})), 0);
  EXPECT_EQ(nmt.command_in(make_frame(0, {1})), 0);
}

TEST_F(NmtTest, Heartbeat_BeyondItsTime_IsReportedLostOnce) {
  HeartbeatConsumer consumer;
  consumer.configure(0, 0x00050064);
  EXPECT_FALSE(consumer.process(1'000'000)) << "watching begins with the first one";
  EXPECT_FALSE(consumer.handle(make_frame(0x705, {5}), 1'000'000));
  EXPECT_FALSE(consumer.process(1'099'999));
  EXPECT_EQ(consumer.process(1'100'000), 0U);
  EXPECT_EQ(consumer.node_of(0), 5);
  EXPECT_FALSE(consumer.process(1'200'000));
  EXPECT_EQ(consumer.handle(make_frame(0x705, {5}), 1'300'000), 0U) << "back";
}

TEST_F(NmtTest, Heartbeats_OfTwoNodes_AreReportedLostSeparately) {
  HeartbeatConsumer consumer;
  consumer.configure(2, 0x00050064);
  consumer.configure(7, 0x00060064);
  consumer.handle(make_frame(0x705, {5}), 0);
  consumer.handle(make_frame(0x706, {5}), 0);
  EXPECT_EQ(consumer.process(100'000), 2U);
  EXPECT_EQ(consumer.process(100'000), 7U);
  EXPECT_FALSE(consumer.process(100'000));
}

TEST_F(NmtTest, OwnHeartbeat_NodeLateByAPeriod_IsSentOnce) {
  port.take_sent();
  nmt.process(port, 100, 0);
  EXPECT_EQ(port.take_sent().size(), 1U);
  nmt.process(port, 100, 200'000);
  nmt.process(port, 100, 200'000);
  EXPECT_EQ(port.take_sent().size(), 1U);
  nmt.process(port, 100, 299'999);
  EXPECT_TRUE(port.take_sent().empty());
  nmt.process(port, 100, 300'000);
  EXPECT_EQ(port.take_sent().size(), 1U);
}

TEST_F(NmtTest, UnwatchedNode_IsNeitherLostNorBack) {
  HeartbeatConsumer consumer;
  EXPECT_FALSE(consumer.handle(make_frame(0x705, {5}), 0));
  for (std::size_t slot = 0; slot < HeartbeatConsumer::kNodes; ++slot) {
    consumer.configure(slot, (1U + static_cast<std::uint32_t>(slot)) << 16 | 100U);
  }
  EXPECT_FALSE(consumer.handle(make_frame(0x70A, {5}), 0));
  EXPECT_FALSE(consumer.process(1'000'000)) << "none has been heard";
}

TEST_F(NmtTest, Heartbeat_NoLongerWatched_IsNotReportedLost) {
  HeartbeatConsumer consumer;
  consumer.configure(0, 0x00050064);
  consumer.handle(make_frame(0x705, {5}), 0);
  ASSERT_EQ(consumer.process(100'000), 0U);
  consumer.configure(0, 0);
  EXPECT_FALSE(consumer.process(200'000));
}

TEST_F(NmtTest, Heartbeat_InARemoteOrLongerFrame_IsIgnored) {
  HeartbeatConsumer consumer;
  consumer.configure(0, 0x00050064);
  CanFrame remote = make_frame(0x705, {5});
  remote.flags = kFrameRemote;
  consumer.handle(remote, 0);
  consumer.handle(make_frame(0x705, {5, 5}), 0);
  EXPECT_FALSE(consumer.process(1'000'000)) << "never heard, so never missed";
}

}  // namespace
}  // namespace armtrue::canopen
