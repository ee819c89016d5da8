// A model of the Zynq UltraScale+ CAN controller behind the register interface: modes, both FIFOs,
// interrupt causes, error state. For tests.
#ifndef ARMTRUE_FIRMWARE_PORTS_R5F_FAKE_ZYNQMP_CAN_H_
#define ARMTRUE_FIRMWARE_PORTS_R5F_FAKE_ZYNQMP_CAN_H_

#include <array>
#include <cstdint>
#include <deque>
#include <map>
#include <stdexcept>
#include <vector>

#include "firmware/ports/r5f/zynqmp_can.h"

namespace armtrue::r5f {

class FakeZynqMpCan {
 public:
  static constexpr std::size_t kFifo = 64;
  bool is_present = true;
  // Set: the bus carries no eleven recessive bits, so that the controller cannot leave its
  // configuration mode.
  bool is_bus_dominant = false;

  std::uint32_t read(std::uint32_t offset) const {
    if (!is_present) return 0;
    switch (offset) {
      case zynqmp_can::kSr:
        return (takes_part() ? 0 : zynqmp_can::kSrConfiguration) | error_state_;
      case zynqmp_can::kIsr:
        return causes_ | (received_.empty() ? 0 : zynqmp_can::kIrqReceiveNotEmpty);
      case zynqmp_can::kRxFifoId:
      case zynqmp_can::kRxFifoDlc:
      case zynqmp_can::kRxFifoData1:
      case zynqmp_can::kRxFifoData2:
        return take_word((offset - zynqmp_can::kRxFifoId) / 4);
      default: {
        const auto written = written_.find(offset);
        return written == written_.end() ? 0 : written->second;
      }
    }
  }

  void write(std::uint32_t offset, std::uint32_t value) {
    written_[offset] = value;
    if (!is_present) return;
    if (offset == zynqmp_can::kSrr) {
      if ((value & zynqmp_can::kSrrReset) != 0) reset();
      is_enabled_ = (value & zynqmp_can::kSrrEnable) != 0;
    } else if (offset == zynqmp_can::kIcr) {
      causes_ &= ~value;
    } else if (offset >= zynqmp_can::kTxFifoId && offset <= zynqmp_can::kTxFifoData2) {
      put_word((offset - zynqmp_can::kTxFifoId) / 4, value);
    }
  }

  // The bus takes the oldest frame. False if there is none or the controller is not enabled.
  bool transmit_one() {
    if (to_send_.empty() || !takes_part()) return false;
    sent.push_back(to_send_.front());
    to_send_.pop_front();
    causes_ |= zynqmp_can::kIrqTransmitOk;
    return true;
  }

  void deliver(const FifoWords& frame) {
    if (received_.size() == kFifo) {
      causes_ |= zynqmp_can::kIrqReceiveOverflow;
    } else {
      received_.push_back(frame);
    }
  }

  // `state`: bits of the status register. Bus-off raises the interrupt.
  void set_error_state(std::uint32_t state) {
    error_state_ = state;
    if ((state & zynqmp_can::kSrStateMask) == zynqmp_can::kSrBusOff) {
      causes_ |= zynqmp_can::kIrqBusOff;
    }
  }

  bool is_enabled() const { return is_enabled_; }
  bool is_requesting() const { return (read(zynqmp_can::kIsr) & read(zynqmp_can::kIer)) != 0; }

  std::vector<FifoWords> sent;

 private:
  bool takes_part() const { return is_enabled_ && !is_bus_dominant; }

  static std::uint32_t& word_of(FifoWords& frame, std::uint32_t index) {
    return *std::array{&frame.id, &frame.dlc, &frame.data1, &frame.data2}[index];
  }

  void reset() {
    written_.clear();
    to_send_.clear();
    received_.clear();
    causes_ = 0;
    error_state_ = 0;
    next_word_ = 0;
  }

  std::uint32_t take_word(std::uint32_t index) const {
    if (received_.empty() || index != next_read_)
      throw std::logic_error("receive FIFO read out of turn");
    const std::uint32_t word = word_of(received_.front(), index);
    next_read_ = (next_read_ + 1) % 4;
    if (next_read_ == 0) received_.pop_front();
    return word;
  }

  void put_word(std::uint32_t index, std::uint32_t value) {
    if (index != next_word_) throw std::logic_error("transmit FIFO written out of turn");
    if (to_send_.size() >= kFifo) throw std::logic_error("transmit FIFO overrun");
    word_of(frame_, index) = value;
    next_word_ = (next_word_ + 1) % 4;
    if (next_word_ == 0) to_send_.push_back(frame_);
  }

  std::map<std::uint32_t, std::uint32_t> written_;
  std::deque<FifoWords> to_send_;
  mutable std::deque<FifoWords> received_;
  FifoWords frame_;
  std::uint32_t next_word_ = 0;
  mutable std::uint32_t next_read_ = 0;
  std::uint32_t causes_ = 0;
  std::uint32_t error_state_ = 0;
  bool is_enabled_ = false;
};

}  // namespace armtrue::r5f

#endif  // ARMTRUE_FIRMWARE_PORTS_R5F_FAKE_ZYNQMP_CAN_H_
