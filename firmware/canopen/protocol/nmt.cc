#include "firmware/canopen/protocol/nmt.h"

namespace armtrue::canopen {
namespace {

constexpr std::uint8_t kAllNodes = 0;

}  // namespace

bool Nmt::send_state(CanPort& port, NmtState state) const {
  CanFrame frame;
  frame.id = kHeartbeatBase + node_id_;
  frame.len = 1;
  frame.data[0] = static_cast<std::uint8_t>(state);
  return port.send(frame);
}

bool Nmt::boot(CanPort& port, std::uint64_t now_us) {
  if (!send_state(port, NmtState::kInitialising)) return false;
  state_ = NmtState::kPreOperational;
  next_heartbeat_us_ = now_us;
  return true;
}

std::uint8_t Nmt::command_in(const CanFrame& frame) const {
  const bool is_command = frame.len == 2 && !frame.is(kFrameRemote) && !frame.is(kFrameFd) &&
                          is_defined(frame.data[0]) && state_ != NmtState::kInitialising;
  const bool is_ours = frame.data[1] == kAllNodes || frame.data[1] == node_id_;
  return is_command && is_ours ? frame.data[0] : std::uint8_t{0};
}

NmtRequest Nmt::apply(std::uint8_t command) {
  switch (command) {
    case kNmtStart:
      state_ = NmtState::kOperational;
      break;
    case kNmtStop:
      state_ = NmtState::kStopped;
      break;
    case kNmtEnterPreOperational:
      state_ = NmtState::kPreOperational;
      break;
    case kNmtResetNode:
      state_ = NmtState::kInitialising;
      return NmtRequest::kResetNode;
    case kNmtResetCommunication:
      state_ = NmtState::kInitialising;
      return NmtRequest::kResetCommunication;
    default:
      break;
  }
  return NmtRequest::kNone;
}

void Nmt::process(CanPort& port, std::uint16_t producer_ms, std::uint64_t now_us) {
  if (state_ == NmtState::kInitialising || producer_ms == 0 || now_us < next_heartbeat_us_) return;
  if (!send_state(port, state_)) return;
  const std::uint64_t period_us = producer_ms * std::uint64_t{1000};
  next_heartbeat_us_ += period_us;
  // After a long pause: one heartbeat, not a burst of those that were missed.
  if (next_heartbeat_us_ <= now_us) next_heartbeat_us_ = now_us + period_us;
}

void HeartbeatConsumer::configure(std::size_t slot, std::uint32_t value) {
  if (slot >= watches_.size()) return;
  Watch watch;
  watch.node_id = static_cast<std::uint8_t>((value >> 16) & 0xFFU);
  watch.time_us = (value & 0xFFFFU) * 1000U;
  watches_[slot] = watch;
}

std::optional<std::size_t> HeartbeatConsumer::handle(const CanFrame& frame, std::uint64_t now_us) {
  if (frame.len != 1 || frame.is(kFrameRemote)) return std::nullopt;
  for (std::size_t slot = 0; slot < kNodes; ++slot) {
    Watch& watch = watches_[slot];
    if (watch.time_us == 0 || frame.id != kHeartbeatBase + watch.node_id) continue;
    const bool back = watch.lost;
    watch.seen = true;
    watch.lost = false;
    watch.deadline_us = now_us + watch.time_us;
    return back ? std::optional(slot) : std::nullopt;
  }
  return std::nullopt;
}

void HeartbeatConsumer::excuse(std::uint64_t deaf_us) {
  for (Watch& watch : watches_) watch.deadline_us += deaf_us;
}

std::optional<std::size_t> HeartbeatConsumer::process(std::uint64_t now_us) {
  for (std::size_t slot = 0; slot < kNodes; ++slot) {
    Watch& watch = watches_[slot];
    if (watch.time_us == 0 || !watch.seen || watch.lost || now_us < watch.deadline_us) continue;
    watch.lost = true;
    return slot;
  }
  return std::nullopt;
}

}  // namespace armtrue::canopen
