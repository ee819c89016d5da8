// A CAN controller whose bus is two queues. For tests and the in-process simulation.
#ifndef ARMTRUE_FIRMWARE_TESTING_SIMULATED_PORT_H_
#define ARMTRUE_FIRMWARE_TESTING_SIMULATED_PORT_H_

#include <cstddef>
#include <cstdint>
#include <deque>
#include <initializer_list>
#include <optional>
#include <vector>

#include "firmware/canopen/protocol/can_port.h"

namespace armtrue::canopen {

// Behaves as a controller does with full queues or bus-off, without hardware.
class SimulatedPort final : public CanPort {
 public:
  // `room`: frames that fit into the transmit queue before send() refuses.
  explicit SimulatedPort(bool fd = false, std::size_t room = SIZE_MAX) : fd_(fd), room_(room) {}

  bool queue(const CanFrame& frame, const Command* command) override {
    const bool possible = frame.len <= (frame.is(kFrameFd) ? kFdPayload : kClassicPayload) &&
                          (!frame.is(kFrameFd) || (fd_ && is_valid_fd_length(frame.len)));
    if (!possible || state_ == BusState::kBusOff || waiting() >= room_) {
      ++counters_.send_refused;
      return false;
    }
    held_up_.push_back({frame, command == nullptr ? std::nullopt : std::optional(*command)});
    pass_held_up();
    return true;
  }

  void discard_commands(Discarded& discarded) override {
    std::erase_if(held_up_, [&](const HeldUp& held) {
      if (!held.command) return false;
      discarded.note(*held.command);
      note_command_gone();
      ++counters_.send_refused;
      return true;
    });
  }

  bool receive(CanFrame& frame) override {
    if (arrived_.empty()) return false;
    frame = arrived_.front();
    arrived_.pop_front();
    ++counters_.received;
    return true;
  }

  // In a queue of limited length, the first places stand for the controller's mailboxes.
  bool has_backlog() override { return room_ != SIZE_MAX && waiting() > kMailboxes; }

  std::uint8_t longest_burst() const override { return longest_burst_; }

  BusState bus_state() override { return state_; }

  void recover() override {
    if (state_ != BusState::kBusOff) return;
    Discarded unused;
    discard_commands(unused);
    sent_.clear();
    held_up_.clear();
    state_ = BusState::kActive;
    ++recoveries_;
  }

  BusCounters counters() const override { return counters_; }
  bool supports_fd() const override { return fd_; }

  // The side of the bus.
  void deliver(const CanFrame& frame) { arrived_.push_back(frame); }
  std::vector<CanFrame> take_sent() {
    std::vector<CanFrame> frames(sent_.begin(), sent_.end());
    sent_.clear();
    return frames;
  }
  // The bus takes the oldest frame. Returns false if there is none.
  bool take_one(CanFrame& frame) {
    if (sent_.empty()) return false;
    frame = sent_.front();
    sent_.pop_front();
    return true;
  }
  std::size_t waiting() const { return sent_.size() + held_up_.size(); }
  // While the bus takes nothing (no acknowledgement), frames wait in the controller and can be
  // discarded. Otherwise it takes them at once.
  void set_acknowledged(bool is_acknowledged) {
    is_acknowledged_ = is_acknowledged;
    pass_held_up();
  }
  void set_state(BusState state) {
    if (state == BusState::kBusOff && state_ != state) ++counters_.bus_off_entries;
    state_ = state;
  }
  void lose_frames(std::uint32_t count) { counters_.receive_overruns += count; }
  void set_room(std::size_t room) { room_ = room; }
  void set_longest_burst(std::uint8_t frames) { longest_burst_ = frames; }
  std::size_t recoveries() const { return recoveries_; }

 private:
  static constexpr std::size_t kMailboxes = 3;
  struct HeldUp {
    CanFrame frame;
    std::optional<Command> command;
  };

  void pass_held_up() {
    for (; is_acknowledged_ && !held_up_.empty(); held_up_.pop_front()) {
      sent_.push_back(held_up_.front().frame);
      ++counters_.sent;
      if (held_up_.front().command) note_command_gone();
    }
  }

  bool fd_;
  bool is_acknowledged_ = true;
  std::size_t room_;
  std::uint8_t longest_burst_ = CanPort::longest_burst();
  BusState state_ = BusState::kActive;
  BusCounters counters_;
  std::deque<CanFrame> arrived_;
  std::deque<CanFrame> sent_;  // taken by the bus
  std::deque<HeldUp> held_up_;
  std::size_t recoveries_ = 0;
};

// A classic data frame.
inline CanFrame make_frame(std::uint32_t id, std::initializer_list<int> bytes) {
  CanFrame frame;
  frame.id = id;
  for (const int byte : bytes) frame.data[frame.len++] = static_cast<std::uint8_t>(byte);
  return frame;
}

// The same with `len` bytes that count up.
inline CanFrame counting_frame(std::uint32_t id, std::uint8_t first_byte, std::uint8_t len = 8) {
  CanFrame frame;
  frame.id = id;
  frame.len = len;
  for (std::uint8_t i = 0; i < len; ++i) frame.data[i] = static_cast<std::uint8_t>(first_byte + i);
  return frame;
}

}  // namespace armtrue::canopen

#endif  // ARMTRUE_FIRMWARE_TESTING_SIMULATED_PORT_H_
