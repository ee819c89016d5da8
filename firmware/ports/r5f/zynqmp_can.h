// The CAN controller of the Zynq UltraScale+ (AMD UG1085, chapter 20; registers: UG1087, module
// CAN).
//
// Frames leave in the order in which they were queued. They wait in a queue of 64, and only the
// oldest is in the controller, which has no way to take one back but a reset. Received frames wait
// in a queue of 64 behind the controller's FIFO of 64. After bus-off the controller would rejoin
// the bus by itself; the driver holds it in configuration mode until recover() is called.
#ifndef ARMTRUE_FIRMWARE_PORTS_R5F_ZYNQMP_CAN_H_
#define ARMTRUE_FIRMWARE_PORTS_R5F_ZYNQMP_CAN_H_

#include <cstddef>
#include <cstdint>

#include "firmware/canopen/protocol/can_port.h"
#include "firmware/core/fixed/counter.h"
#include "firmware/ports/common/bit_timing.h"
#include "firmware/ports/common/classic_frame.h"
#include "firmware/ports/common/interrupt_lock.h"
#include "firmware/ports/common/register_block.h"

namespace armtrue::r5f {

namespace zynqmp_can {

// Register offsets and bits, named as in UG1087.
enum Offset : std::uint32_t {
  kSrr = 0x00,
  kMsr = 0x04,
  kBrpr = 0x08,
  kBtr = 0x0C,
  kSr = 0x18,
  kIsr = 0x1C,
  kIer = 0x20,
  kIcr = 0x24,
  kTxFifoId = 0x30,
  kTxFifoDlc = 0x34,
  kTxFifoData1 = 0x38,
  kTxFifoData2 = 0x3C,
  kRxFifoId = 0x50,
  kRxFifoDlc = 0x54,
  kRxFifoData1 = 0x58,
  kRxFifoData2 = 0x5C,
  kAfr = 0x60,
};

inline constexpr std::uint32_t kSrrReset = 1U << 0;
inline constexpr std::uint32_t kSrrEnable = 1U << 1;
inline constexpr std::uint32_t kSrConfiguration = 1U << 0;
inline constexpr std::uint32_t kSrWarning = 1U << 6;
inline constexpr std::uint32_t kSrStateMask = 3U << 7;
inline constexpr std::uint32_t kSrBusOff = 2U << 7;
inline constexpr std::uint32_t kSrPassive = 3U << 7;
inline constexpr std::uint32_t kIrqTransmitOk = 1U << 1;
inline constexpr std::uint32_t kIrqReceiveOverflow = 1U << 6;
inline constexpr std::uint32_t kIrqReceiveNotEmpty = 1U << 7;
inline constexpr std::uint32_t kIrqBusOff = 1U << 9;

inline constexpr std::uint32_t kDlcShift = 28;

}  // namespace zynqmp_can

// Layout of identifier and data in the FIFO registers.
enum class FifoLayout : std::uint8_t {
  kHardware,  // identifier left-aligned in two fields, first data byte in the top bits (UG1087)
  kEmulated,  // QEMU's model (Xilinx/qemu issue 74): identifier as in SocketCAN, first data byte in
              // the bottom bits
};

// The four words of a frame in the FIFO registers.
struct FifoWords {
  std::uint32_t id = 0;
  std::uint32_t dlc = 0;
  std::uint32_t data1 = 0;
  std::uint32_t data2 = 0;
};

FifoWords to_fifo(const ports::ClassicFrame& frame, FifoLayout layout);
ports::ClassicFrame from_fifo(const FifoWords& words, FifoLayout layout);

template <ports::RegisterBlock Registers>
class ZynqMpCan final : public canopen::CanPort {
 public:
  static constexpr std::size_t kQueue = 64;
  // QEMU 7.2 aborts if a frame arrives while its FIFO of 64 is almost full and a frame is half
  // read: a burst stays well below that.
  static constexpr std::uint8_t kEmulatedBurst = 32;

  ZynqMpCan(Registers& registers, FifoLayout layout) : registers_(registers), layout_(layout) {}

  // Resets the controller, sets the bit timing and joins the bus. False if the controller does not
  // answer (there is none) or `timing` has prescaler 0; the bus may be silent, dominant or absent.
  bool start(const ports::BitTiming& timing);

  // If the oldest frame is a command, resets the controller, which joins the bus again.
  void discard_commands(canopen::Discarded& discarded) override;
  bool receive(canopen::CanFrame& frame) override { return ports::take_received(received_, frame); }
  std::uint8_t longest_burst() const override {
    return layout_ == FifoLayout::kEmulated ? kEmulatedBurst : CanPort::longest_burst();
  }
  canopen::BusState bus_state() override;
  void recover() override;
  canopen::BusCounters counters() const override { return counters_; }

  // Handler of the controller's only interrupt. Has no effect without a cause, so that it can also
  // be polled.
  void on_interrupt();

 protected:
  bool queue(const canopen::CanFrame& frame, const canopen::Command* command) override;

 private:
  bool join();
  void load_oldest();
  void note_sent();
  void receive_one();
  bool has_joined() const {
    return (registers_.read(zynqmp_can::kSr) & zynqmp_can::kSrConfiguration) == 0;
  }

  Registers& registers_;
  FifoLayout layout_;
  ports::BitTiming timing_;
  ports::Queue<ports::ClassicFrame, kQueue> to_send_;
  bool is_loaded_ = false;  // the oldest frame of to_send_ is in the controller
  ports::Queue<ports::ClassicFrame, kQueue> received_;
  canopen::BusCounters counters_;
  bool is_off_ = false;
  // Error passive before a reset of discard_commands(), which clears the error counters, and no
  // frame has left or come since.
  bool is_still_passive_ = false;
  bool is_recovering_ = false;  // since recover(), until the controller has joined the bus
};

template <ports::RegisterBlock Registers>
bool ZynqMpCan<Registers>::start(const ports::BitTiming& timing) {
  if (timing.prescaler == 0) return false;
  timing_ = timing;
  return join();
}

// Begins the way from reset to normal mode. The controller joins after eleven recessive bits
// (UG1085, configuration mode), which a faulty bus may not carry for any length of time: frames
// that are queued before that wait for it, and bus_state() notices the end of bus-off.
template <ports::RegisterBlock Registers>
bool ZynqMpCan<Registers>::join() {
  constexpr std::uint32_t kPolls = 1000;  // a reset takes some cycles of the bus clock
  registers_.write(zynqmp_can::kSrr, zynqmp_can::kSrrReset);
  if (!ports::wait_for(registers_, zynqmp_can::kSr, zynqmp_can::kSrConfiguration,
                       zynqmp_can::kSrConfiguration, kPolls)) {
    return false;
  }
  registers_.write(zynqmp_can::kBrpr, timing_.prescaler - 1);
  registers_.write(zynqmp_can::kBtr, ((timing_.jump_width - 1) << 7) |
                                         ((timing_.segment2 - 1) << 4) | (timing_.segment1 - 1));
  registers_.write(zynqmp_can::kAfr, 0);  // no filter: every frame is received
  registers_.write(zynqmp_can::kIer, zynqmp_can::kIrqTransmitOk | zynqmp_can::kIrqReceiveNotEmpty |
                                         zynqmp_can::kIrqReceiveOverflow | zynqmp_can::kIrqBusOff);
  registers_.write(zynqmp_can::kSrr, zynqmp_can::kSrrEnable);
  return true;
}

template <ports::RegisterBlock Registers>
bool ZynqMpCan<Registers>::queue(const canopen::CanFrame& frame, const canopen::Command* command) {
  const ports::InterruptLock lock;
  note_sent();
  if (!ports::is_classic(frame) || is_off_ ||
      !to_send_.push(ports::ClassicFrame::from(frame, command))) {
    count(counters_.send_refused);
    return false;
  }
  load_oldest();
  return true;
}

// Before the controller has joined the bus the frames wait here; bus_state() notices.
template <ports::RegisterBlock Registers>
void ZynqMpCan<Registers>::load_oldest() {
  if (is_loaded_ || is_off_ || to_send_.empty() || !has_joined()) return;
  is_loaded_ = true;
  const FifoWords words = to_fifo(to_send_[0], layout_);
  registers_.write(zynqmp_can::kTxFifoId, words.id);
  registers_.write(zynqmp_can::kTxFifoDlc, words.dlc);
  registers_.write(zynqmp_can::kTxFifoData1, words.data1);
  registers_.write(zynqmp_can::kTxFifoData2, words.data2);  // the fourth word queues the frame
}

// Takes note of a frame that has left, and loads the next one.
template <ports::RegisterBlock Registers>
void ZynqMpCan<Registers>::note_sent() {
  if ((registers_.read(zynqmp_can::kIsr) & zynqmp_can::kIrqTransmitOk) == 0) return;
  registers_.write(zynqmp_can::kIcr, zynqmp_can::kIrqTransmitOk);
  ports::ClassicFrame sent;
  if (!is_loaded_ || !to_send_.pop(sent)) return;
  is_loaded_ = is_still_passive_ = false;
  count(counters_.sent);
  if (sent.is_command()) note_command_gone();
  load_oldest();
}

template <ports::RegisterBlock Registers>
void ZynqMpCan<Registers>::discard_commands(canopen::Discarded& discarded) {
  const ports::InterruptLock lock;
  note_sent();
  const bool is_oldest_in_controller = is_loaded_ && to_send_[0].is_command();
  to_send_.erase_if([&](const ports::ClassicFrame& frame) {
    if (!frame.is_command()) return false;
    discarded.note(frame.command);
    note_command_gone();
    count(counters_.send_refused);
    return true;
  });
  if (!is_oldest_in_controller) return;
  is_loaded_ = false;
  if (is_off_) return;  // the recovery resets the controller
  const std::uint32_t state = registers_.read(zynqmp_can::kSr) & zynqmp_can::kSrStateMask;
  is_still_passive_ = is_still_passive_ || state == zynqmp_can::kSrPassive;
  while ((registers_.read(zynqmp_can::kIsr) & zynqmp_can::kIrqReceiveNotEmpty) != 0) receive_one();
  join();
}

template <ports::RegisterBlock Registers>
canopen::BusState ZynqMpCan<Registers>::bus_state() {
  const ports::InterruptLock lock;
  if (is_recovering_ && has_joined()) is_recovering_ = is_off_ = false;
  load_oldest();
  const std::uint32_t status = registers_.read(zynqmp_can::kSr);
  if (is_off_) return canopen::BusState::kBusOff;
  const std::uint32_t state = status & zynqmp_can::kSrStateMask;
  // Already bus-off, but the interrupt that sets is_off_ has not been served yet.
  if (state == zynqmp_can::kSrBusOff) return canopen::BusState::kBusOff;
  if (state == zynqmp_can::kSrPassive || is_still_passive_) return canopen::BusState::kPassive;
  return (status & zynqmp_can::kSrWarning) != 0 ? canopen::BusState::kWarning
                                                : canopen::BusState::kActive;
}

template <ports::RegisterBlock Registers>
void ZynqMpCan<Registers>::recover() {
  const ports::InterruptLock lock;
  if (!is_off_ || is_recovering_) return;
  canopen::Discarded unused;
  discard_commands(unused);
  to_send_.clear();
  is_loaded_ = is_still_passive_ = false;
  is_recovering_ = join();
}

template <ports::RegisterBlock Registers>
void ZynqMpCan<Registers>::on_interrupt() {
  for (std::uint32_t cause = registers_.read(zynqmp_can::kIsr) & registers_.read(zynqmp_can::kIer);
       cause != 0; cause = registers_.read(zynqmp_can::kIsr) & registers_.read(zynqmp_can::kIer)) {
    if ((cause & zynqmp_can::kIrqTransmitOk) != 0) note_sent();
    if ((cause & zynqmp_can::kIrqReceiveNotEmpty) != 0) receive_one();
    if ((cause & zynqmp_can::kIrqReceiveOverflow) != 0) {
      count(counters_.receive_overruns);
    }
    if ((cause & zynqmp_can::kIrqBusOff) != 0) {
      count(counters_.bus_off_entries);
      is_off_ = true;
      is_recovering_ = false;
      registers_.write(zynqmp_can::kSrr, 0);  // configuration mode: no recovery until asked for
    }
    // A frame that note_sent() has loaded may have left by now.
    registers_.write(zynqmp_can::kIcr, cause & ~zynqmp_can::kIrqTransmitOk);
  }
}

template <ports::RegisterBlock Registers>
void ZynqMpCan<Registers>::receive_one() {
  FifoWords words;  // a reading removes the word: read each once, in this order
  words.id = registers_.read(zynqmp_can::kRxFifoId);
  words.dlc = registers_.read(zynqmp_can::kRxFifoDlc);
  words.data1 = registers_.read(zynqmp_can::kRxFifoData1);
  words.data2 = registers_.read(zynqmp_can::kRxFifoData2);
  const bool kept = received_.push(from_fifo(words, layout_));
  count(kept ? counters_.received : counters_.receive_overruns);
  is_still_passive_ = false;
}

}  // namespace armtrue::r5f

#endif  // ARMTRUE_FIRMWARE_PORTS_R5F_ZYNQMP_CAN_H_
