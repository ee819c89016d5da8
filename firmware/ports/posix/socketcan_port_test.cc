// Frames that wait in the process while the kernel's queue is full. The bus is a socket pair.
#include "firmware/ports/posix/socketcan_port.h"

#include <gtest/gtest.h>
#include <sys/socket.h>
#include <unistd.h>

#include <array>
#include <csignal>
#include <cstdint>
#include <string>
#include <vector>

#include "firmware/testing/simulated_port.h"

namespace armtrue::posix {
namespace {

using canopen::CanFrame;
using canopen::counting_frame;
using canopen::Discarded;

class SocketCanPortTest : public testing::Test {
 protected:
  void SetUp() override {
    ASSERT_EQ(socketpair(AF_UNIX, SOCK_SEQPACKET | SOCK_NONBLOCK, 0, ends_.data()), 0);
    constexpr int kSmall = 1;  // the kernel raises it to its minimum
    setsockopt(ends_[0], SOL_SOCKET, SO_SNDBUF, &kSmall, sizeof kSmall);
    ASSERT_EQ(port_.open("fd:" + std::to_string(ends_[0])), "");
  }
  void TearDown() override { close(ends_[1]); }

  // Sends commands until one waits in the process.
  void fill_kernel() {
    for (std::uint8_t k = 0; port_.commands().gone == port_.commands().accepted; ++k) {
      ASSERT_TRUE(port_.send_command(counting_frame(0x220, 0), {0x01, k}));
    }
  }
  // Identifiers of all frames that the peer reads while the port's loop runs.
  std::vector<std::uint32_t> take_all() {
    std::vector<std::uint32_t> result;
    can_frame frame = {};
    CanFrame unused;
    while (read(ends_[1], &frame, sizeof frame) == sizeof frame) {
      result.push_back(frame.can_id);
      port_.receive(unused);
    }
    return result;
  }

  std::array<int, 2> ends_ = {};
  SocketCanPort port_;
};

TEST_F(SocketCanPortTest, FullKernelQueue_OtherFramesAreSentLater) {
  fill_kernel();
  const std::uint32_t in_kernel = port_.commands().gone;
  ASSERT_TRUE(port_.send(counting_frame(0x5A0, 0)));
  ASSERT_TRUE(port_.send_command(counting_frame(0x320, 0), {0x04, 9}));
  ASSERT_TRUE(port_.send(counting_frame(0x0A0, 0)));
  Discarded discarded;
  port_.discard_commands(discarded);
  EXPECT_EQ(discarded.axes, 0x05);
  EXPECT_EQ(discarded.cycle[0], in_kernel);
  EXPECT_EQ(discarded.cycle[2], 9);
  EXPECT_EQ(port_.commands().gone, port_.commands().accepted);
  EXPECT_EQ(port_.counters().send_refused, 2U);
  const std::vector<std::uint32_t> left = take_all();
  ASSERT_EQ(left.size(), in_kernel + 2);
  EXPECT_EQ(left[in_kernel], 0x5A0U);
  EXPECT_EQ(left[in_kernel + 1], 0x0A0U);
  EXPECT_EQ(port_.counters().sent, in_kernel + 2);
}

TEST_F(SocketCanPortTest, FullQueue_RefusesFrames) {
  fill_kernel();
  std::size_t accepted = 1;
  while (port_.send(counting_frame(0x5A0, 0))) ++accepted;
  EXPECT_EQ(accepted, 64U);
  EXPECT_EQ(port_.counters().send_refused, 1U);
}

TEST_F(SocketCanPortTest, ClosedBus_RefusesFramesAtOnce) {
  signal(SIGPIPE, SIG_IGN);
  close(ends_[1]);
  EXPECT_FALSE(port_.send(counting_frame(0x5A0, 0)));
  EXPECT_FALSE(port_.send_command(counting_frame(0x220, 0), {}));
  EXPECT_EQ(port_.counters().send_refused, 2U);
  EXPECT_EQ(port_.commands().accepted, 0U);
}

}  // namespace
}  // namespace armtrue::posix
