#include "firmware/ports/stm32f405/usart.h"

#include <gtest/gtest.h>

#include <deque>
#include <string>

namespace armtrue::stm32f405 {
namespace {

// One byte each way, and the interrupt line.
class FakeUsart {
 public:
  std::uint32_t read(std::uint32_t offset) const {
    if (offset == usart::kSr) {
      return (has_byte_ ? usart::kSrReceived : 0) | (overrun_ ? usart::kSrOverrun : 0) |
             (sending_ ? 0 : usart::kSrEmpty);
    }
    if (offset == usart::kDr) {
      has_byte_ = overrun_ = false;
      return byte_;
    }
    return offset == usart::kBrr ? divider_ : control_;
  }

  void write(std::uint32_t offset, std::uint32_t value) {
    if (offset == usart::kDr) {
      EXPECT_FALSE(sending_) << "a byte was overwritten";
      sending_ = true;
      sent += static_cast<char>(value);
    } else if (offset == usart::kBrr) {
      divider_ = value;
    } else if (offset == usart::kCr1) {
      control_ = value;
    }
  }

  void deliver(std::uint8_t byte) {
    overrun_ = has_byte_;
    has_byte_ = true;
    byte_ = byte;
  }
  void finish_sending() { sending_ = false; }

  bool is_requesting() const {
    return (has_byte_ && (control_ & usart::kCr1ReceivedInterrupt) != 0) ||
           (!sending_ && (control_ & usart::kCr1EmptyInterrupt) != 0);
  }

  std::string sent;

 private:
  std::uint32_t control_ = 0;
  std::uint32_t divider_ = 0;
  mutable bool has_byte_ = false;
  mutable bool overrun_ = false;
  bool sending_ = false;
  std::uint8_t byte_ = 0;
};

class UsartTest : public testing::Test {
 protected:
  void SetUp() override { usart_.start(84'000'000, 1'000'000); }

  void run_interrupts() {
    for (fake_.finish_sending(); fake_.is_requesting(); fake_.finish_sending()) {
      usart_.on_interrupt();
    }
  }

  FakeUsart fake_;
  Usart<FakeUsart> usart_{fake_};
};

TEST_F(UsartTest, Start_SetsTheBaudRateDivider) { EXPECT_EQ(fake_.read(usart::kBrr), 84U); }

TEST_F(UsartTest, SendsEverythingInOrderAndThenIsQuiet) {
  const std::string text = "t1234AABBCCDD\r";
  usart_.write({reinterpret_cast<const std::uint8_t*>(text.data()), text.size()});
  EXPECT_EQ(usart_.writable(), Usart<FakeUsart>::kQueue - text.size() + 1) << "one is under way";
  run_interrupts();
  EXPECT_EQ(fake_.sent, text);
  EXPECT_FALSE(fake_.is_requesting());
}

TEST_F(UsartTest, ReceivesInOrder) {
  for (std::uint8_t i = 0; i < 100; ++i) {
    fake_.deliver(i);
    run_interrupts();
  }
  std::uint8_t byte = 0;
  for (std::uint8_t i = 0; i < 100; ++i) {
    ASSERT_TRUE(usart_.read(byte));
    EXPECT_EQ(byte, i);
  }
  EXPECT_FALSE(usart_.read(byte));
  EXPECT_EQ(usart_.overruns(), 0U);
}

TEST_F(UsartTest, FullReceiveQueue_HoldsTheSender_LosesNothing) {
  for (std::size_t i = 0; i < Usart<FakeUsart>::kQueue; ++i) {
    fake_.deliver(1);
    run_interrupts();
  }
  fake_.deliver(2);
  run_interrupts();
  EXPECT_FALSE(fake_.is_requesting());
  std::uint8_t byte = 0;
  ASSERT_TRUE(usart_.read(byte));
  run_interrupts();
  std::size_t left = 0;
  while (usart_.read(byte)) ++left;
  EXPECT_EQ(left, Usart<FakeUsart>::kQueue);
  EXPECT_EQ(byte, 2);
}

TEST_F(UsartTest, LostBytes_AreCounted) {
  fake_.deliver(1);
  fake_.deliver(2);
  run_interrupts();
  EXPECT_EQ(usart_.overruns(), 1U);
}

}  // namespace
}  // namespace armtrue::stm32f405
