#include "firmware/canopen/node/node.h"

#include <algorithm>
#include <optional>

#include "firmware/canopen/protocol/cob_id.h"
#include "firmware/core/fixed/counter.h"

namespace armtrue::canopen {
namespace {

constexpr std::uint32_t kSdoRequestBase = 0x600;
constexpr std::uint32_t kSdoResponseBase = 0x580;
constexpr std::uint32_t kMaxNodeId = 127;

// If the saved parameters cannot be loaded, the device is in forward mode and targets pass
// uncorrected. The arm may not show this, so EMCY 0x5530 reports it: 0x101 damaged, 0x102 saved by
// another firmware.
void report(Loaded loaded, Emcy& emcy) {
  if (loaded == Loaded::kDamaged) emcy.raise(Condition::kStorage, 0x101);
  if (loaded == Loaded::kOther) emcy.raise(Condition::kStorage, 0x102);
}

// Whether a frame keeps its meaning while it waits: NMT, EMCY, SDO, error control, LSS (by the
// identifiers of CiA 301, 7.3.5). All others are taken for commands, whose time passes: SYNC, time
// stamp, PDOs, frames of other protocols.
bool is_service(const CanFrame& frame) {
  constexpr std::uint32_t kEmcy = 1;
  constexpr std::uint32_t kSdoResponse = kSdoResponseBase >> 7;
  constexpr std::uint32_t kSdoRequest = kSdoRequestBase >> 7;
  constexpr std::uint32_t kErrorControl = kHeartbeatBase >> 7;
  if (frame.is(kFrameExtended)) return false;
  const std::uint32_t function = frame.id >> 7;
  return frame.id == kNmtCommandId || function == kEmcy || function == kSdoResponse ||
         function == kSdoRequest || function >= kErrorControl;
}

}  // namespace

Node::Node(const NodeConfig& config, const NodeParts& parts)
    : config_(config),
      parts_(parts),
      nmt_(config.node_id),
      emcy_(dictionary_),
      pdos_(dictionary_, parts.upstream.supports_fd() ? kFdPayload : kClassicPayload),
      joints_(dictionary_, parts.compensator, emcy_, parts.upstream, parts.downstream,
              config.joint_count, config.clock_us),
      tables_(dictionary_, parts.compensator, parts.store, emcy_, parts.device, parts.buffers,
              *this),
      access_(dictionary_, *this, tables_),
      sdo_(parts.upstream, access_),
      tpdos_(dictionary_, pdos_, *this),
      upstream_watch_(parts.upstream, emcy_, Condition::kBusOffUpstream) {
  if (parts.downstream != nullptr) {
    downstream_watch_.emplace(*parts.downstream, emcy_, Condition::kBusOffDownstream);
  }
}

void Node::start(std::uint64_t now_us) {
  now_us_ = now_us;
  dictionary_.restore_defaults(config_.node_id);
  report(load_parameters(dictionary_, parts_.parameters), emcy_);
  std::array<char, kSerialLength + 1> serial = {};
  std::copy(parts_.device.robot_serial.begin(), parts_.device.robot_serial.end(), serial.begin());
  dictionary_.set_string(od::kRobotSerial, serial.data());
  tables_.start();
  tables_.set_enabled(dictionary_.get(od::compensator_control::kCorrectionEnable) != 0);
  apply_configuration();
}

void Node::reset_communication(std::uint64_t now_us) {
  now_us_ = now_us;
  joints_.stop();
  dictionary_.restore_communication_defaults(config_.node_id);
  // Saved values are the power-on values of this area (CiA 301, 7.3.2.2.1). Objects outside it
  // stay: the correction's enable and the scales must not change without the compensator.
  const Loaded loaded = load_parameters(dictionary_, parts_.parameters, kCommunicationEnd);
  emcy_.reset();
  report(loaded, emcy_);
  apply_configuration();
}

void Node::apply_configuration() {
  dictionary_.set(od::identity_object::kSerialNumber, config_.serial_number);
  for (std::size_t k = 0; k < HeartbeatConsumer::kNodes; ++k) {
    heartbeats_.configure(k, dictionary_.get(od::kConsumerHeartbeatTime[k]));
  }
  configure_pdos();
  joints_.configure_bounds();
  sdo_.reset(kSdoRequestBase + config_.node_id, kSdoResponseBase + config_.node_id);
  waiting_count_ = 0;
  short_rpdos_ = 0;
}

void Node::configure_pdos() {
  if (joints_.is_configured()) withheld_.note(pdos_);
  pdos_.refresh();
  joints_.configure(pdos_);
  if (joints_.is_configured()) withheld_.clear();
}

bool Node::is_quiet() const {
  const std::uint64_t needed_us =
      dictionary_.get(od::compensator_control::kQuietTimeBeforeCommit) * std::uint64_t{1000};
  return joints_.quiet_us(now_us_) >= needed_us;
}

NodeAction Node::process(std::uint64_t now_us) {
  now_us_ = now_us;
  joint_path_sound_ = false;
  if (nmt_.state() == NmtState::kInitialising && nmt_.boot(parts_.upstream, now_us)) {
    known_state_ = nmt_.state();
  }
  carry_out();
  CanFrame frame;
  for (int k = 0; k < kFramesPerTurn && parts_.upstream.receive(frame); ++k) handle_upstream(frame);
  if (parts_.downstream != nullptr) {
    for (int k = 0; k < kFramesPerTurn && parts_.downstream->receive(frame); ++k) {
      handle_downstream(frame);
    }
  }
  if (pending_reset_ == NmtRequest::kResetNode) return NodeAction::kRestart;
  if (pending_reset_ == NmtRequest::kResetCommunication) {
    pending_reset_ = NmtRequest::kNone;
    reset_communication(now_us);
    return NodeAction::kNone;
  }
  joint_path_sound_ = joints_.process(now_us);
  watch_buses();
  while (const std::optional<std::size_t> lost = heartbeats_.process(now_us)) {
    emcy_.raise(Condition::kHeartbeatLost, heartbeats_.node_of(*lost), *lost);
    communication_error();
  }
  const NmtState state = nmt_.state();
  if (state == NmtState::kPreOperational || state == NmtState::kOperational) {
    sdo_.process(now_us, is_quiet());
    emcy_.process(parts_.upstream, now_us);
  }
  if (state == NmtState::kOperational) tpdos_.process(parts_.upstream, now_us);
  nmt_.process(parts_.upstream, dictionary_.get(od::kProducerHeartbeatTime), now_us);
  return NodeAction::kNone;
}

void Node::watch_buses() {
  Discarded discarded;
  upstream_watch_.process(now_us_, discarded);
  if (downstream_watch_) downstream_watch_->process(now_us_, discarded);
  joints_.note_discarded(discarded);
}

void Node::note_nmt_state() {
  if (nmt_.state() == known_state_) return;
  // Output and TPDOs exist in operational only: both restart with every change.
  joints_.stop();
  tpdos_.restart(now_us_);
  if (nmt_.state() == NmtState::kStopped) {
    sdo_.reset(kSdoRequestBase + config_.node_id, kSdoResponseBase + config_.node_id);
  }
  known_state_ = nmt_.state();
}

void Node::carry_out() {
  const auto wanted = static_cast<Mode>(dictionary_.get(od::compensator_control::kMode));
  const bool ends = Nmt::leaves_operational(nmt_command_) || wanted != mode();
  if (nmt_.state() == NmtState::kOperational) {
    if (joints_.fade(now_us_)) outputs_are_fresh();
    const bool leaves = mode() == Mode::kOffset && (ends || joints_.is_leaving());
    if (leaves && joints_.leave(now_us_)) return;
  }
  if (wanted != mode()) joints_.set_mode(wanted);
  if (nmt_command_ == 0) return;
  const NmtRequest request = nmt_.apply(nmt_command_);
  if (request != NmtRequest::kNone) pending_reset_ = request;
  nmt_command_ = 0;
  note_nmt_state();
}

// A reset that waits for the offsets to become zero is replaced by reset node only; of other
// commands the last one counts.
void Node::note_nmt_command(std::uint8_t command) {
  const bool waits = nmt_command_ == kNmtResetNode || nmt_command_ == kNmtResetCommunication;
  if (Nmt::is_defined(command) && (!waits || command == kNmtResetNode)) nmt_command_ = command;
}

void Node::communication_error() {
  // 0x1029 sub 1: 0 pre-operational (if operational), 1 no change, 2 stopped.
  const std::uint8_t behaviour = dictionary_.get(od::error_behaviour::kCommunicationError);
  if (behaviour == 0 && nmt_.state() == NmtState::kOperational) {
    note_nmt_command(kNmtEnterPreOperational);
  } else if (behaviour == 2) {
    note_nmt_command(kNmtStop);
  }
}

void Node::handle_upstream(const CanFrame& frame) {
  if (is_sync(frame)) return handle_sync(frame);
  if (!frame.is(kFrameExtended) && serve(frame)) return;
  const std::size_t number = pdos_.match(frame);
  const bool is_target = joints_.carries_target(number);
  if (number < kRpdos) handle_rpdo(number, frame);
  const Pdo* lost = withheld_.find(frame);
  const Pdo* pdo = number < kRpdos ? &pdos_.rpdo(number) : lost;
  // In inline mode the joint path decides whether and when a target is passed on. A command to stop
  // passes in every NMT state.
  if (mode() == Mode::kInline && (is_target || (lost != nullptr && withholds()))) {
    return joints_.forward_stop(*pdo, frame);
  }
  if (parts_.downstream == nullptr) return;
  watch_sdo_targets(frame);
  if (to_drives(frame) && pdo != nullptr) joints_.note_forwarded(*pdo, frame);
}

bool Node::withholds() {
  if (is_free_of_correction()) return false;
  joints_.note_command(now_us_);
  emcy_.raise(Condition::kSetsWithheld, kNoSet);
  return true;
}

void Node::handle_downstream(CanFrame& frame) {
  has_heard_drives_ = true;
  drives_heard_us_ = now_us_;
  if (!frame.is(kFrameExtended)) handle_heartbeat(frame);
  const std::size_t number = pdos_.match(frame);
  if (number < kRpdos) joints_.hear(pdos_.rpdo(number), frame);
  if (number < kRpdos && pdos_.rpdo(number).mapping.has_axis_object(kActualPosition)) {
    joints_.note_drives_downstream();
    if (mode() == Mode::kInline) {
      // Without its mapped length, nothing says where the positions are from which the correction
      // would have to be removed.
      if (!is_whole(number, frame)) return;
      joints_.take_feedback(pdos_.rpdo(number), frame, now_us_);
    }
  } else if (number < kRpdos && !joints_.carries_target(number)) {
    handle_rpdo(number, frame);
  }
  const bool is_out = parts_.upstream.send(frame);
  count(is_out ? from_downstream_.forwarded : from_downstream_.dropped);
}

bool Node::to_drives(const CanFrame& frame) {
  CanPort& port = *parts_.downstream;
  const bool is_out =
      is_service(frame) && !is_sync(frame) ? port.send(frame) : port.send_command(frame, {});
  count(is_out ? from_upstream_.forwarded : from_upstream_.dropped);
  return is_out;
}

bool Node::serve(const CanFrame& frame) {
  if (frame.id == kNmtCommandId) {
    note_nmt_command(nmt_.command_in(frame));
    carry_out();
    return false;
  }
  handle_heartbeat(frame);
  if (frame.id != sdo_.request_id()) return false;
  const NmtState state = nmt_.state();
  if (state == NmtState::kPreOperational || state == NmtState::kOperational) {
    // Requests that take long are refused while joints are commanded.
    const bool may_take_long = is_quiet();
    const bool is_watched = may_take_long && parts_.note_long_request != nullptr;
    tables_.set_quiet(may_take_long);
    if (is_watched) parts_.note_long_request(true);
    sdo_.handle(frame, now_us_);
    if (is_watched) parts_.note_long_request(false);
  }
  return true;
}

bool Node::is_sync(const CanFrame& frame) const {
  return !frame.is(kFrameExtended) &&
         frame.id == (dictionary_.get(od::kCOBIDSYNCMessage) & kIdMask);
}

// Sends the targets that wait for SYNC, then SYNC itself, then everything else.
void Node::handle_sync(const CanFrame& frame) {
  const std::uint64_t begin_us = config_.clock_us();
  const std::uint8_t length = dictionary_.get(od::kSynchronousCounterOverflowValue) != 0 ? 1 : 0;
  const bool counts = !frame.is(kFrameRemote) && frame.len == length;
  const bool obeyed = counts && nmt_.state() == NmtState::kOperational;
  const bool fresh = obeyed && joints_.on_sync(now_us_);
  if (parts_.downstream != nullptr) {
    to_drives(frame);
    const auto took_us = static_cast<std::uint32_t>(config_.clock_us() - begin_us);
    sync_latency_.note(took_us);
    sync_jitter_.note(std::max(took_us, last_sync_latency_us_) -
                      std::min(took_us, last_sync_latency_us_));
    last_sync_latency_us_ = took_us;
  }
  if (fresh) outputs_are_fresh();
  obey_sync(frame);
}

void Node::obey_sync(const CanFrame& frame) {
  const std::uint8_t overflow = dictionary_.get(od::kSynchronousCounterOverflowValue);
  const std::uint8_t expected_length = overflow != 0 ? 1 : 0;
  if (frame.is(kFrameRemote)) return;
  if (frame.len != expected_length) {
    emcy_.raise(Condition::kSyncLength, frame.len);
    return;
  }
  emcy_.clear(Condition::kSyncLength);
  if (nmt_.state() != NmtState::kOperational) return;
  for (const Waiting& input : std::span(waiting_).first(waiting_count_)) {
    joints_.take_input(pdos_.rpdo(input.rpdo), input.frame, now_us_);
  }
  waiting_count_ = 0;
  const std::uint8_t counter = overflow != 0 ? frame.data[0] : std::uint8_t{0};
  const std::uint32_t refused =
      tpdos_.on_sync(parts_.upstream, counter, joints_.last_cycle(), now_us_);
  joints_.note_offsets(refused, tpdos_.unsent(), now_us_);
}

void Node::handle_heartbeat(const CanFrame& frame) {
  if (frame.id <= kHeartbeatBase || frame.id > kHeartbeatBase + kMaxNodeId) return;
  const std::optional<std::size_t> back = heartbeats_.handle(frame, now_us_);
  if (back) emcy_.clear(Condition::kHeartbeatLost, *back);
}

void Node::handle_rpdo(std::size_t number, const CanFrame& frame) {
  const Pdo& pdo = pdos_.rpdo(number);
  const bool is_target = pdo.mapping.has_axis_object(kTargetPosition);
  if (is_target) joints_.note_command(now_us_);
  joints_.hear(pdo, frame);
  const bool is_feedback = pdo.mapping.has_axis_object(kActualPosition);
  // Actual positions are taken in every NMT state, because the first set begins with them.
  if (!is_feedback && nmt_.state() != NmtState::kOperational) return;
  if (joints_.carries_target(number)) {
    if (mode() == Mode::kForward) return;
    if (joints_.take_target(pdo, number, frame, now_us_)) outputs_are_fresh();
    return;
  }
  if (mode() != Mode::kForward && is_target) {
    // Targets that belong to no set are never corrected.
    emcy_.raise(Condition::kSetsWithheld, kNoSet);
  }
  if (!is_whole(number, frame)) return;
  if (is_feedback) {
    // The frame itself stays unchanged; 0x6064 and the TPDOs that map it give the position without
    // the correction.
    CanFrame copy = frame;
    return joints_.take_feedback(pdo, copy, now_us_);
  }
  if (!pdo.is_synchronous() || !keep_for_sync(number, frame)) {
    joints_.take_input(pdo, frame, now_us_);
  }
}

bool Node::is_whole(std::size_t number, const CanFrame& frame) {
  constexpr std::size_t kSource = 1;  // 0: the targets, whose end the joint path decides
  const std::uint32_t bit = 1U << number;
  if (frame.len < pdos_.rpdo(number).mapping.length) {
    short_rpdos_ |= bit;
    joints_.note_malformed();
    emcy_.raise(Condition::kPdoLength, frame.id, kSource);
    return false;
  }
  if (short_rpdos_ == bit) emcy_.clear(Condition::kPdoLength, kSource);
  short_rpdos_ &= ~bit;
  return true;
}

bool Node::keep_for_sync(std::size_t number, const CanFrame& frame) {
  std::size_t place = 0;
  while (place < waiting_count_ && waiting_[place].rpdo != number) ++place;
  if (place == waiting_.size()) return false;
  waiting_[place] = {frame, static_cast<std::uint8_t>(number)};
  waiting_count_ = std::max(waiting_count_, place + 1);
  return true;
}

void Node::outputs_are_fresh() {
  if (mode() != Mode::kOffset) return;
  const std::uint32_t refused =
      tpdos_.on_fresh_outputs(parts_.upstream, joints_.last_cycle(), now_us_, joints_.is_leaving());
  joints_.note_offsets(refused, tpdos_.unsent(), now_us_);
}

void Node::watch_sdo_targets(const CanFrame& frame) {
  const bool to_a_node = frame.id > kSdoRequestBase && frame.id <= kSdoRequestBase + kMaxNodeId;
  if (frame.is(kFrameExtended) || !to_a_node || frame.len != 8) return;
  const bool begins_download = (frame.data[0] & 0xE0U) == 0x20U;
  const bool begins_block_download = (frame.data[0] & 0xE1U) == 0xC0U;
  if (mode() != Mode::kInline || !(begins_download || begins_block_download)) return;
  if (axis_object(load_le<std::uint16_t>(&frame.data[1])) != kTargetPosition) return;
  count(sdo_targets_);
  emcy_.raise(Condition::kTargetBySdo, frame.id - kSdoRequestBase);
}

}  // namespace armtrue::canopen
