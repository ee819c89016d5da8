#include "firmware/ports/common/slcan_port.h"

#include <gtest/gtest.h>

#include <deque>
#include <string>

namespace armtrue::ports {
namespace {

using canopen::CanFrame;

class FakeStream : public ByteStream {
 public:
  bool read(std::uint8_t& byte) override {
    if (to_device.empty()) return false;
    byte = static_cast<std::uint8_t>(to_device.front());
    to_device.pop_front();
    return true;
  }
  std::size_t writable() const override { return room; }
  void write(std::span<const std::uint8_t> bytes) override {
    EXPECT_LE(bytes.size(), room);
    room -= bytes.size();
    from_device.append(bytes.begin(), bytes.end());
  }

  std::deque<char> to_device;
  std::string from_device;
  std::size_t room = 1000;
};

class SlcanPortTest : public testing::Test {
 protected:
  // The port's answer to `text` while it sends no frames.
  std::string answer(const std::string& text) {
    stream_.from_device.clear();
    stream_.to_device.insert(stream_.to_device.end(), text.begin(), text.end());
    frames_ = 0;
    while (port_.receive(frame_)) ++frames_;
    return stream_.from_device;
  }

  FakeStream stream_;
  SlcanPort port_{stream_};
  CanFrame frame_;
  int frames_ = 0;
};

TEST_F(SlcanPortTest, OpenCommandsOfPythonCan_AreAccepted) {
  EXPECT_EQ(answer("C\rS8\rO\r"), "\r\r\r");
  EXPECT_EQ(answer("t0010\r"), "z\r");
}

TEST_F(SlcanPortTest, ReceivesEveryKindOfFrame) {
  answer("C\rO\r");
  EXPECT_EQ(answer("t12F3AbcD01\r"), "z\r");
  EXPECT_EQ(frame_.id, 0x12FU);
  EXPECT_EQ(frame_.flags, canopen::kFrameNone);
  ASSERT_EQ(frame_.len, 3);
  EXPECT_EQ(frame_.data[0], 0xAB);
  EXPECT_EQ(frame_.data[2], 0x01);
  EXPECT_EQ(answer("T1FFFFFFF80011223344556677\r"), "Z\r");
  EXPECT_EQ(frame_.id, 0x1FFFFFFFU);
  EXPECT_EQ(frame_.flags, canopen::kFrameExtended);
  EXPECT_EQ(frame_.data[7], 0x77);
  EXPECT_EQ(answer("r7FF2\r"), "z\r");
  EXPECT_TRUE(frame_.is(canopen::kFrameRemote));
  EXPECT_EQ(answer("R000000010\r"), "Z\r");
  EXPECT_TRUE(frame_.is(canopen::kFrameRemote) && frame_.is(canopen::kFrameExtended));
  EXPECT_EQ(port_.counters().received, 4U);
}

TEST_F(SlcanPortTest, LinesInAnyPieces_AreReceived) {
  answer("C\rO\r");
  EXPECT_EQ(answer("t0011"), "");
  EXPECT_EQ(answer("05\rt00"), "z\r");
  EXPECT_EQ(frame_.data[0], 5);
  EXPECT_EQ(answer("20\r\nt0030\r"), "z\rz\r");
  EXPECT_EQ(frames_, 2);
}

TEST_F(SlcanPortTest, InvalidLine_IsRefused) {
  answer("C\rO\r");
  for (const char* line :
       {"t\r", "t001\r", "t0019\r", "t00111\r", "t001100FF\r", "t8000\r", "tG010\r", "t0011G0\r",
        "T200000000\r", "r0010AB\r", "t-010\r", "T1FFFFFFF800112233445566778\r", "xyz\r", "S8\r",
        "O\r", "O1\r", "C1\r"}) {
    EXPECT_EQ(answer(line), "\a") << line;
    EXPECT_EQ(frames_, 0) << line;
  }
  EXPECT_EQ(answer("t0010\r"), "z\r") << "and goes on";
}

TEST_F(SlcanPortTest, LineWithoutEnd_IsRefusedWithoutOverflow) {
  answer("C\rO\r");
  EXPECT_EQ(answer(std::string(100000, 't')), "");
  EXPECT_EQ(answer("\r"), "\a");
  EXPECT_EQ(answer("t0010\r"), "z\r");
}

TEST_F(SlcanPortTest, IsOpenAfterARestart) {
  EXPECT_TRUE(port_.send({}));
  EXPECT_EQ(stream_.from_device, "t0000\r");
  EXPECT_EQ(answer("t0010\r"), "z\r");
}

TEST_F(SlcanPortTest, SendsNothingWhileClosed) {
  CanFrame frame;
  answer("C\r");
  EXPECT_FALSE(port_.send(frame));
  EXPECT_EQ(answer("t0010\r"), "\a");
  answer("C\rO\r");
  EXPECT_TRUE(port_.send(frame));
  answer("C\r");
  EXPECT_FALSE(port_.send(frame));
  EXPECT_EQ(port_.counters().send_refused, 2U);
  EXPECT_EQ(port_.counters().sent, 1U);
}

TEST_F(SlcanPortTest, ListenMode_RefusesIncomingFrames_StillSends) {
  EXPECT_EQ(answer("C\rL\r"), "\r\r");
  EXPECT_EQ(answer("t0010\r"), "\a");
  EXPECT_TRUE(port_.send({}));
}

TEST_F(SlcanPortTest, SendsEveryKindOfFrame) {
  answer("C\rO\r");
  stream_.from_device.clear();
  CanFrame frame;
  frame.id = 0x5A1;
  frame.len = 2;
  frame.data[0] = 0x0F;
  frame.data[1] = 0xA0;
  ASSERT_TRUE(port_.send(frame));
  frame.flags = canopen::kFrameExtended;
  ASSERT_TRUE(port_.send(frame));
  frame.flags = canopen::kFrameRemote;
  ASSERT_TRUE(port_.send(frame));
  EXPECT_EQ(stream_.from_device, "t5A120FA0\rT000005A120FA0\rr5A12\r");
}

TEST_F(SlcanPortTest, FrameThatDoesNotFit_IsRefusedAndNotPartlySent) {
  answer("C\rO\r");
  CanFrame frame;
  frame.len = 8;
  stream_.from_device.clear();
  stream_.room = 21;
  EXPECT_FALSE(port_.send(frame));
  EXPECT_EQ(stream_.from_device, "");
  stream_.room = 22;
  EXPECT_TRUE(port_.send(frame));
  stream_.room = 1000;
  frame.flags = canopen::kFrameFd;
  EXPECT_FALSE(port_.send(frame));
  frame.flags = 0;
  frame.len = 9;
  EXPECT_FALSE(port_.send(frame));
  EXPECT_EQ(port_.counters().send_refused, 3U);
}

TEST_F(SlcanPortTest, AnswersQueries) { EXPECT_EQ(answer("V\rN\rF\r\r"), "V1013\rN0000\rF00\r\r"); }

TEST_F(SlcanPortTest, EverySentFrame_IsReceivedUnchanged) {
  answer("C\rO\r");
  for (std::uint32_t i = 0; i < 5000; ++i) {
    CanFrame frame;
    frame.flags = i % 2 != 0 ? canopen::kFrameExtended : canopen::kFrameNone;
    frame.id = i * 2654435761U & (i % 2 != 0 ? 0x1FFFFFFFU : 0x7FFU);
    frame.len = static_cast<std::uint8_t>(i % 9);
    for (std::uint8_t k = 0; k < frame.len; ++k)
      frame.data[k] = static_cast<std::uint8_t>(i * (k + 3U) >> 2);
    stream_.from_device.clear();
    stream_.room = 1000;
    ASSERT_TRUE(port_.send(frame));
    answer(std::string(stream_.from_device));
    ASSERT_EQ(frames_, 1);
    ASSERT_EQ(frame_.id, frame.id);
    ASSERT_EQ(frame_.flags, frame.flags);
    ASSERT_EQ(frame_.len, frame.len);
    ASSERT_TRUE(std::equal(frame.data, frame.data + frame.len, frame_.data));
  }
}

}  // namespace
}  // namespace armtrue::ports
