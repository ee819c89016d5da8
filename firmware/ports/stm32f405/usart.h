// A serial port of the STM32F405 (ST RM0090, section 30): eight bits, no parity, one stop bit,
// queues both ways.
#ifndef ARMTRUE_FIRMWARE_PORTS_STM32F405_USART_H_
#define ARMTRUE_FIRMWARE_PORTS_STM32F405_USART_H_

#include <cstddef>
#include <cstdint>
#include <span>

#include "firmware/ports/common/byte_stream.h"
#include "firmware/ports/common/interrupt_lock.h"
#include "firmware/ports/common/queue.h"
#include "firmware/ports/common/register_block.h"

namespace armtrue::stm32f405 {

namespace usart {

// Register offsets and bits, named as in the manual (30.6).
inline constexpr std::uint32_t kSr = 0x00;
inline constexpr std::uint32_t kDr = 0x04;
inline constexpr std::uint32_t kBrr = 0x08;
inline constexpr std::uint32_t kCr1 = 0x0C;
inline constexpr std::uint32_t kSrOverrun = 1U << 3;
inline constexpr std::uint32_t kSrReceived = 1U << 5;
inline constexpr std::uint32_t kSrEmpty = 1U << 7;
inline constexpr std::uint32_t kCr1Receive = 1U << 2;
inline constexpr std::uint32_t kCr1Transmit = 1U << 3;
inline constexpr std::uint32_t kCr1ReceivedInterrupt = 1U << 5;
inline constexpr std::uint32_t kCr1EmptyInterrupt = 1U << 7;
inline constexpr std::uint32_t kCr1Enable = 1U << 13;

}  // namespace usart

template <ports::RegisterBlock Registers>
class Usart final : public ports::ByteStream {
 public:
  // One line of SLCAN is at most 27 bytes; a full set of target frames and its replies fit several
  // times.
  static constexpr std::size_t kQueue = 1024;

  explicit Usart(Registers& registers) : registers_(registers) {}

  // `clock_hz`: of the peripheral's bus. The rate is the clock divided by an integer.
  void start(std::uint32_t clock_hz, std::uint32_t bits_per_second) {
    registers_.write(usart::kCr1, 0);
    registers_.write(usart::kBrr, (clock_hz + bits_per_second / 2) / bits_per_second);
    registers_.write(usart::kCr1, kRunning | usart::kCr1ReceivedInterrupt);
  }

  bool read(std::uint8_t& byte) override {
    const ports::InterruptLock lock;
    const bool was_full = received_.room() == 0;
    const bool any = received_.pop(byte);
    if (was_full) serve();
    return any;
  }

  std::size_t writable() const override {
    const ports::InterruptLock lock;
    return to_send_.room();
  }

  void write(std::span<const std::uint8_t> bytes) override {
    const ports::InterruptLock lock;
    for (const std::uint8_t byte : bytes) to_send_.push(byte);
    serve();
  }

  void on_interrupt() { serve(); }

  // Number of overruns: bytes came faster than they were read.
  std::uint32_t overruns() const { return overruns_; }

 private:
  static constexpr std::uint32_t kRunning =
      usart::kCr1Enable | usart::kCr1Transmit | usart::kCr1Receive;

  // Also called by write(), because QEMU 7.2 raises no interrupt for an empty transmitter.
  void serve() {
    const std::uint32_t status = registers_.read(usart::kSr);
    // Reading the data register clears the request and an overrun (30.6.1). While the queue is full
    // the byte stays in the register, so that a line with flow control stops the sender.
    if ((status & (usart::kSrReceived | usart::kSrOverrun)) != 0 && received_.room() > 0) {
      received_.push(static_cast<std::uint8_t>(registers_.read(usart::kDr)));
      if ((status & usart::kSrOverrun) != 0) ++overruns_;
    }
    std::uint8_t byte = 0;
    while ((registers_.read(usart::kSr) & usart::kSrEmpty) != 0 && to_send_.pop(byte)) {
      registers_.write(usart::kDr, byte);
    }
    registers_.write(usart::kCr1, kRunning |
                                      (received_.room() > 0 ? usart::kCr1ReceivedInterrupt : 0) |
                                      (!to_send_.empty() ? usart::kCr1EmptyInterrupt : 0));
  }

  Registers& registers_;
  ports::Queue<std::uint8_t, kQueue> received_;
  ports::Queue<std::uint8_t, kQueue> to_send_;
  std::uint32_t overruns_ = 0;
};

}  // namespace armtrue::stm32f405

#endif  // ARMTRUE_FIRMWARE_PORTS_STM32F405_USART_H_
