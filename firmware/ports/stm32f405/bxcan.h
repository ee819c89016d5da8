// bxCAN, the CAN controller of the STM32F405 (ST RM0090, section 32).
//
// A queue of 32 frames feeds the three mailboxes. Frames leave in the order in which they were
// queued (TXFP), whatever their identifiers; commands can be withdrawn from both. Received frames
// wait in a queue of 32 behind the three places of FIFO 0. Bus-off ends only through recover()
// (ABOM is off), so that the node decides about it.
#ifndef ARMTRUE_FIRMWARE_PORTS_STM32F405_BXCAN_H_
#define ARMTRUE_FIRMWARE_PORTS_STM32F405_BXCAN_H_

#include <array>
#include <cstdint>
#include <initializer_list>
#include <optional>

#include "firmware/canopen/protocol/can_port.h"
#include "firmware/core/fixed/counter.h"
#include "firmware/ports/common/bit_timing.h"
#include "firmware/ports/common/classic_frame.h"
#include "firmware/ports/common/interrupt_lock.h"
#include "firmware/ports/common/register_block.h"

namespace armtrue::stm32f405 {

namespace bxcan {

// Register offsets and bits, named as in the manual (32.9).
enum Offset : std::uint32_t {
  kMcr = 0x000,
  kMsr = 0x004,
  kTsr = 0x008,
  kRf0r = 0x00C,
  kIer = 0x014,
  kEsr = 0x018,
  kBtr = 0x01C,
  kTransmitMailbox = 0x180,
  kReceiveFifo = 0x1B0,
  kMailboxStride = 0x10,
  kIdentifier = 0x0,  // within a mailbox
  kLength = 0x4,
  kDataLow = 0x8,
  kDataHigh = 0xC,
  kFmr = 0x200,
  kFm1r = 0x204,
  kFs1r = 0x20C,
  kFfa1r = 0x214,
  kFa1r = 0x21C,
  kFilterBank = 0x240,
  kFilterStride = 0x8,
};

inline constexpr std::uint32_t kMcrInrq = 1U << 0;
inline constexpr std::uint32_t kMcrSleep = 1U << 1;
inline constexpr std::uint32_t kMcrTxfp = 1U << 2;
inline constexpr std::uint32_t kMsrInak = 1U << 0;
inline constexpr std::uint32_t kMsrErri = 1U << 2;
inline constexpr std::uint32_t kRf0rPending = 3U << 0;
inline constexpr std::uint32_t kRf0rOverrun = 1U << 4;
inline constexpr std::uint32_t kRf0rRelease = 1U << 5;
inline constexpr std::uint32_t kIerTransmit = 1U << 0;
inline constexpr std::uint32_t kIerReceive = 1U << 1;
inline constexpr std::uint32_t kIerBusOff = 1U << 10;
inline constexpr std::uint32_t kIerError = 1U << 15;
inline constexpr std::uint32_t kEsrWarning = 1U << 0;
inline constexpr std::uint32_t kEsrPassive = 1U << 1;
inline constexpr std::uint32_t kEsrBusOff = 1U << 2;
inline constexpr std::uint32_t kIdRequest = 1U << 0;
inline constexpr std::uint32_t kIdRemote = 1U << 1;
inline constexpr std::uint32_t kIdExtended = 1U << 2;
inline constexpr std::uint32_t kFmrInit = 1U << 0;

inline constexpr std::uint32_t kMailboxes = 3;
constexpr std::uint32_t tsr_completed(std::uint32_t mailbox) { return 1U << (8 * mailbox); }
constexpr std::uint32_t tsr_ok(std::uint32_t mailbox) { return 2U << (8 * mailbox); }
constexpr std::uint32_t tsr_abort(std::uint32_t mailbox) { return 0x80U << (8 * mailbox); }
constexpr std::uint32_t tsr_empty(std::uint32_t mailbox) { return 1U << (26 + mailbox); }

}  // namespace bxcan

// Lets every frame through to FIFO 0, on both controllers: the first 14 filter banks belong to
// CAN1, the rest to CAN2. The filters of both are in the registers of CAN1. Call before either
// controller starts.
template <ports::RegisterBlock Registers>
void accept_all_frames(Registers& can1) {
  constexpr std::uint32_t kFirstOfCan2 = 14;
  constexpr std::uint32_t kUsed = (1U << 0) | (1U << kFirstOfCan2);
  can1.write(bxcan::kFmr, (kFirstOfCan2 << 8) | bxcan::kFmrInit);
  can1.write(bxcan::kFa1r, 0);
  can1.write(bxcan::kFm1r, 0);      // identifier and mask
  can1.write(bxcan::kFs1r, kUsed);  // 32 bits wide
  can1.write(bxcan::kFfa1r, 0);     // FIFO 0
  for (const std::uint32_t bank : {std::uint32_t{0}, kFirstOfCan2}) {
    can1.write(bxcan::kFilterBank + bank * bxcan::kFilterStride, 0);
    can1.write(bxcan::kFilterBank + bank * bxcan::kFilterStride + 4, 0);
  }
  can1.write(bxcan::kFa1r, kUsed);
  can1.write(bxcan::kFmr, kFirstOfCan2 << 8);
}

template <ports::RegisterBlock Registers>
class BxCan final : public canopen::CanPort {
 public:
  static constexpr std::size_t kQueue = 32;

  explicit BxCan(Registers& registers) : registers_(registers) {}

  // Sets the bit timing and joins the bus. False if the controller does not answer (there is none)
  // or `timing` has prescaler 0; the bus may be silent or absent.
  bool start(const ports::BitTiming& timing);

  void discard_commands(canopen::Discarded& discarded) override;
  bool receive(canopen::CanFrame& frame) override { return ports::take_received(received_, frame); }
  // True if frames wait for a mailbox. Needs no lock: an interrupt only makes the answer outdated.
  bool has_backlog() override { return !to_send_.empty(); }
  canopen::BusState bus_state() override;
  void recover() override;
  canopen::BusCounters counters() const override { return counters_; }

  // The interrupts of the controller: transmit mailbox empty, FIFO 0 message pending, status
  // change.
  void on_transmit_interrupt();
  void on_receive_interrupt();
  void on_status_interrupt();

 protected:
  bool queue(const canopen::CanFrame& frame, const canopen::Command* command) override;

 private:
  enum class Recovery : std::uint8_t { kNone, kEntering, kLeaving };

  void load_mailbox(std::uint32_t mailbox, const ports::ClassicFrame& frame);
  ports::ClassicFrame read_fifo() const;
  void discard(canopen::Command command, canopen::Discarded& discarded);
  bool is_bus_off() const { return (registers_.read(bxcan::kEsr) & bxcan::kEsrBusOff) != 0; }
  void note_bus_off();

  Registers& registers_;
  ports::Queue<ports::ClassicFrame, kQueue> to_send_;
  std::array<std::optional<canopen::Command>, bxcan::kMailboxes> in_mailbox_ = {};
  ports::Queue<ports::ClassicFrame, kQueue> received_;
  canopen::BusCounters counters_;
  Recovery recovery_ = Recovery::kNone;
  bool was_bus_off_ = false;
};

template <ports::RegisterBlock Registers>
bool BxCan<Registers>::start(const ports::BitTiming& timing) {
  constexpr std::uint32_t kPolls = 100000;  // some milliseconds: a frame on the bus must end first
  if (timing.prescaler == 0) return false;
  registers_.write(bxcan::kMcr, bxcan::kMcrInrq);  // also ends sleep mode
  if (!ports::wait_for(registers_, bxcan::kMsr, bxcan::kMsrInak, bxcan::kMsrInak, kPolls)) {
    return false;
  }
  registers_.write(bxcan::kBtr, ((timing.jump_width - 1) << 24) | ((timing.segment2 - 1) << 20) |
                                    ((timing.segment1 - 1) << 16) | (timing.prescaler - 1));
  registers_.write(bxcan::kIer,
                   bxcan::kIerTransmit | bxcan::kIerReceive | bxcan::kIerBusOff | bxcan::kIerError);
  // The controller joins after eleven recessive bits; frames queued before that wait for it.
  registers_.write(bxcan::kMcr, bxcan::kMcrTxfp);
  return true;
}

template <ports::RegisterBlock Registers>
bool BxCan<Registers>::queue(const canopen::CanFrame& frame, const canopen::Command* command) {
  const ports::InterruptLock lock;
  if (!ports::is_classic(frame) || recovery_ != Recovery::kNone || is_bus_off() ||
      !to_send_.push(ports::ClassicFrame::from(frame, command))) {
    count(counters_.send_refused);
    return false;
  }
  on_transmit_interrupt();
  return true;
}

template <ports::RegisterBlock Registers>
void BxCan<Registers>::discard(canopen::Command command, canopen::Discarded& discarded) {
  discarded.note(command);
  note_command_gone();
  count(counters_.send_refused);
}

template <ports::RegisterBlock Registers>
void BxCan<Registers>::discard_commands(canopen::Discarded& discarded) {
  const ports::InterruptLock lock;
  on_transmit_interrupt();  // what has left since is none of them
  to_send_.erase_if([&](const ports::ClassicFrame& frame) {
    if (frame.is_command()) discard(frame.command, discarded);
    return frame.is_command();
  });
  std::uint32_t abort = 0;
  for (std::uint32_t i = 0; i < bxcan::kMailboxes; ++i) {
    if (!in_mailbox_[i]) continue;
    discard(*in_mailbox_[i], discarded);
    in_mailbox_[i].reset();
    abort |= bxcan::tsr_abort(i);
  }
  // Ends a frame on the wire after this attempt (32.7.1). The interrupt then loads the next one.
  if (abort != 0) registers_.write(bxcan::kTsr, abort);
}

template <ports::RegisterBlock Registers>
canopen::BusState BxCan<Registers>::bus_state() {
  const ports::InterruptLock lock;
  note_bus_off();
  if (recovery_ == Recovery::kEntering && (registers_.read(bxcan::kMsr) & bxcan::kMsrInak) != 0) {
    registers_.write(bxcan::kMcr, bxcan::kMcrTxfp);
    recovery_ = Recovery::kLeaving;
  }
  if (recovery_ == Recovery::kLeaving && !is_bus_off() &&
      (registers_.read(bxcan::kMsr) & bxcan::kMsrInak) == 0) {
    recovery_ = Recovery::kNone;
  }
  const std::uint32_t status = registers_.read(bxcan::kEsr);
  if (recovery_ != Recovery::kNone || (status & bxcan::kEsrBusOff) != 0) {
    return canopen::BusState::kBusOff;
  }
  if ((status & bxcan::kEsrPassive) != 0) return canopen::BusState::kPassive;
  if ((status & bxcan::kEsrWarning) != 0) return canopen::BusState::kWarning;
  return canopen::BusState::kActive;
}

// The recovery sequence begins when the controller leaves initialisation mode (32.7.6). The time
// that it takes to enter this mode is not bounded: bus_state() takes the next step.
template <ports::RegisterBlock Registers>
void BxCan<Registers>::recover() {
  const ports::InterruptLock lock;
  note_bus_off();
  if (recovery_ != Recovery::kNone || !is_bus_off()) return;
  canopen::Discarded unused;
  discard_commands(unused);
  to_send_.clear();
  std::uint32_t abort = 0;
  for (std::uint32_t i = 0; i < bxcan::kMailboxes; ++i) abort |= bxcan::tsr_abort(i);
  registers_.write(bxcan::kTsr, abort);
  registers_.write(bxcan::kMcr, bxcan::kMcrTxfp | bxcan::kMcrInrq);
  recovery_ = Recovery::kEntering;
}

// Also called outside the interrupt. A new request clears the completion of the one before, so both
// come from one reading of the register: a mailbox is loaded only after its completion was noted.
template <ports::RegisterBlock Registers>
void BxCan<Registers>::on_transmit_interrupt() {
  const std::uint32_t status = registers_.read(bxcan::kTsr);
  std::uint32_t completed = 0;
  for (std::uint32_t i = 0; i < bxcan::kMailboxes; ++i) {
    if ((status & bxcan::tsr_completed(i)) == 0) continue;
    completed |= bxcan::tsr_completed(i);
    if (in_mailbox_[i]) note_command_gone();
    in_mailbox_[i].reset();
    if ((status & bxcan::tsr_ok(i)) != 0) count(counters_.sent);
  }
  if (completed != 0) registers_.write(bxcan::kTsr, completed);  // written ones clear
  if (recovery_ != Recovery::kNone) return;
  ports::ClassicFrame frame;
  for (std::uint32_t i = 0; i < bxcan::kMailboxes; ++i) {
    if ((status & bxcan::tsr_empty(i)) != 0 && to_send_.pop(frame)) load_mailbox(i, frame);
  }
}

template <ports::RegisterBlock Registers>
void BxCan<Registers>::on_receive_interrupt() {
  for (;;) {
    const std::uint32_t fifo = registers_.read(bxcan::kRf0r);
    if ((fifo & bxcan::kRf0rOverrun) != 0) {
      count(counters_.receive_overruns);
      registers_.write(bxcan::kRf0r, bxcan::kRf0rOverrun);
    }
    if ((fifo & bxcan::kRf0rPending) == 0) return;
    count(received_.push(read_fifo()) ? counters_.received : counters_.receive_overruns);
    registers_.write(bxcan::kRf0r, bxcan::kRf0rRelease);
    // The hardware clears the request when the registers hold the next frame.
    constexpr std::uint32_t kPolls = 100;
    ports::wait_for(registers_, bxcan::kRf0r, bxcan::kRf0rRelease, 0, kPolls);
  }
}

template <ports::RegisterBlock Registers>
void BxCan<Registers>::on_status_interrupt() {
  registers_.write(bxcan::kMsr, bxcan::kMsrErri);
  note_bus_off();
}

template <ports::RegisterBlock Registers>
void BxCan<Registers>::load_mailbox(std::uint32_t mailbox, const ports::ClassicFrame& frame) {
  const std::uint32_t base = bxcan::kTransmitMailbox + mailbox * bxcan::kMailboxStride;
  const bool extended = frame.is(canopen::kFrameExtended);
  std::uint32_t identifier = extended ? (frame.id << 3) | bxcan::kIdExtended : frame.id << 21;
  if (frame.is(canopen::kFrameRemote)) identifier |= bxcan::kIdRemote;
  const std::array<std::uint32_t, 2> words = frame.words();
  if (frame.is_command()) in_mailbox_[mailbox] = frame.command;
  registers_.write(base + bxcan::kLength, frame.len);
  registers_.write(base + bxcan::kDataLow, words[0]);
  registers_.write(base + bxcan::kDataHigh, words[1]);
  registers_.write(base + bxcan::kIdentifier, identifier | bxcan::kIdRequest);
}

template <ports::RegisterBlock Registers>
ports::ClassicFrame BxCan<Registers>::read_fifo() const {
  const std::uint32_t identifier = registers_.read(bxcan::kReceiveFifo + bxcan::kIdentifier);
  const std::uint32_t length = registers_.read(bxcan::kReceiveFifo + bxcan::kLength) & 0xFU;
  ports::ClassicFrame frame;
  frame.set_payload(length, {registers_.read(bxcan::kReceiveFifo + bxcan::kDataLow),
                             registers_.read(bxcan::kReceiveFifo + bxcan::kDataHigh)});
  const bool extended = (identifier & bxcan::kIdExtended) != 0;
  frame.id = extended ? identifier >> 3 : identifier >> 21;
  if (extended) frame.flags |= canopen::kFrameExtended;
  if ((identifier & bxcan::kIdRemote) != 0) frame.flags |= canopen::kFrameRemote;
  return frame;
}

// Counts each entry into bus-off once, also if the status interrupt is not handled in time.
template <ports::RegisterBlock Registers>
void BxCan<Registers>::note_bus_off() {
  const bool now = is_bus_off();
  if (now && !was_bus_off_) count(counters_.bus_off_entries);
  was_bus_off_ = now;
}

}  // namespace armtrue::stm32f405

#endif  // ARMTRUE_FIRMWARE_PORTS_STM32F405_BXCAN_H_
