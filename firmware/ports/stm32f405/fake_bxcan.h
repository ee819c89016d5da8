// A model of bxCAN behind the register interface: mailboxes, receive FIFO, error state,
// initialisation. For tests.
#ifndef ARMTRUE_FIRMWARE_PORTS_STM32F405_FAKE_BXCAN_H_
#define ARMTRUE_FIRMWARE_PORTS_STM32F405_FAKE_BXCAN_H_

#include <array>
#include <cstdint>
#include <deque>
#include <map>
#include <vector>

#include "firmware/ports/stm32f405/bxcan.h"

namespace armtrue::stm32f405 {

class FakeBxCan {
 public:
  struct Mailbox {
    std::uint32_t identifier = 0;
    std::uint32_t length = 0;
    std::uint32_t data_low = 0;
    std::uint32_t data_high = 0;
  };

  bool is_present = true;
  // Number of register reads after which the controller acknowledges that it enters or leaves
  // initialisation mode.
  int acknowledge_after = 3;

  std::uint32_t read(std::uint32_t offset) const {
    if (!is_present) return 0;
    step_initialisation();
    switch (offset) {
      case bxcan::kMsr:
        return initialising_ ? bxcan::kMsrInak : 0;
      case bxcan::kTsr:
        return transmit_status_;
      case bxcan::kRf0r:
        return static_cast<std::uint32_t>(fifo_.size()) | (overrun_ ? bxcan::kRf0rOverrun : 0);
      case bxcan::kEsr:
        return error_status_;
      default:
        break;
    }
    if (offset >= bxcan::kReceiveFifo && offset < bxcan::kReceiveFifo + bxcan::kMailboxStride) {
      return fifo_.empty() ? 0 : field(fifo_.front(), offset - bxcan::kReceiveFifo);
    }
    const auto written = written_.find(offset);
    return written == written_.end() ? 0 : written->second;
  }

  void write(std::uint32_t offset, std::uint32_t value) {
    written_[offset] = value;
    if (!is_present) return;
    if (offset == bxcan::kMcr) {
      wants_initialisation_ = (value & bxcan::kMcrInrq) != 0;
      readings_left_ = acknowledge_after;
    } else if (offset == bxcan::kTsr) {
      write_transmit_status(value);
    } else if (offset == bxcan::kRf0r) {
      if ((value & bxcan::kRf0rOverrun) != 0) overrun_ = false;
      if ((value & bxcan::kRf0rRelease) != 0 && !fifo_.empty()) fifo_.pop_front();
    } else if (offset >= bxcan::kTransmitMailbox && offset < bxcan::kReceiveFifo) {
      write_mailbox((offset - bxcan::kTransmitMailbox) / bxcan::kMailboxStride,
                    offset % bxcan::kMailboxStride, value);
    }
  }

  // The bus takes the oldest requested mailbox. False where there is none.
  bool transmit_one(bool successfully = true) {
    if (requested_.empty()) return false;
    const std::uint32_t mailbox = requested_.front();
    requested_.pop_front();
    if (successfully) sent.push_back(mailboxes_[mailbox]);
    transmit_status_ |= bxcan::tsr_completed(mailbox) | bxcan::tsr_empty(mailbox) |
                        (successfully ? bxcan::tsr_ok(mailbox) : 0);
    return true;
  }

  // A frame arrives from the bus. It is lost if three frames wait in the FIFO.
  void deliver(const Mailbox& frame) {
    if (fifo_.size() == 3) {
      overrun_ = true;
    } else {
      fifo_.push_back(frame);
    }
  }

  void set_error_status(std::uint32_t status) { error_status_ = status; }
  bool is_initialising() const { return initialising_; }
  std::size_t requested() const { return requested_.size(); }

  std::vector<Mailbox> sent;

 private:
  static std::uint32_t field(const Mailbox& mailbox, std::uint32_t offset) {
    switch (offset) {
      case bxcan::kIdentifier:
        return mailbox.identifier;
      case bxcan::kLength:
        return mailbox.length;
      case bxcan::kDataLow:
        return mailbox.data_low;
      default:
        return mailbox.data_high;
    }
  }

  void step_initialisation() const {
    if (initialising_ == wants_initialisation_ || --readings_left_ > 0) return;
    initialising_ = wants_initialisation_;
  }

  void write_transmit_status(std::uint32_t value) {
    for (std::uint32_t i = 0; i < bxcan::kMailboxes; ++i) {
      if ((value & bxcan::tsr_completed(i)) != 0) {
        transmit_status_ &= ~(bxcan::tsr_completed(i) | bxcan::tsr_ok(i));
      }
      if ((value & bxcan::tsr_abort(i)) != 0 && std::erase(requested_, i) > 0) {
        transmit_status_ |= bxcan::tsr_completed(i) | bxcan::tsr_empty(i);
      }
    }
  }

  void write_mailbox(std::uint32_t mailbox, std::uint32_t offset, std::uint32_t value) {
    Mailbox& target = mailboxes_[mailbox];
    if (offset == bxcan::kLength) target.length = value;
    if (offset == bxcan::kDataLow) target.data_low = value;
    if (offset == bxcan::kDataHigh) target.data_high = value;
    if (offset != bxcan::kIdentifier) return;
    target.identifier = value;
    if ((value & bxcan::kIdRequest) == 0) return;
    requested_.push_back(mailbox);
    transmit_status_ &=
        ~(bxcan::tsr_empty(mailbox) | bxcan::tsr_completed(mailbox) | bxcan::tsr_ok(mailbox));
  }

  std::map<std::uint32_t, std::uint32_t> written_;
  std::array<Mailbox, bxcan::kMailboxes> mailboxes_;
  std::deque<std::uint32_t> requested_;
  std::deque<Mailbox> fifo_;
  std::uint32_t transmit_status_ = bxcan::tsr_empty(0) | bxcan::tsr_empty(1) | bxcan::tsr_empty(2);
  std::uint32_t error_status_ = 0;
  bool overrun_ = false;
  bool wants_initialisation_ = false;
  mutable bool initialising_ = false;
  mutable int readings_left_ = 0;
};

}  // namespace armtrue::stm32f405

#endif  // ARMTRUE_FIRMWARE_PORTS_STM32F405_FAKE_BXCAN_H_
