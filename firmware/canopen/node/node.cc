#include "firmware/canopen/node/node.h"

#include <algorithm>

#include "firmware/core/division.h"

namespace armtrue::canopen {
namespace {

constexpr std::uint32_t kSdoRequestBase = 0x600;
constexpr std::uint32_t kSdoResponseBase = 0x580;
constexpr std::uint32_t kMaxNodeId = 127;
constexpr std::uint32_t kIdMask = 0x7FF;

void count(std::uint32_t& counter) {
  if (counter != UINT32_MAX) ++counter;
}

// Sub-indexes of one bus status record, in the order of the EDS; the two records are alike.
struct BusStatusRefs {
  od::Ref<std::uint8_t> state;
  od::Ref<std::uint32_t> received, sent, overruns, refused, bus_off, forwarded, dropped;
};

namespace up = od::upstream_bus_status;
namespace down = od::downstream_bus_status;
constexpr BusStatusRefs kUpstreamRefs = {up::kBusState,
                                         up::kFramesReceived,
                                         up::kFramesSent,
                                         up::kReceiveOverruns,
                                         up::kSendRefused,
                                         up::kBusOffEntries,
                                         up::kFramesForwardedFromHere,
                                         up::kFramesDroppedInForwarding};
constexpr BusStatusRefs kDownstreamRefs = {down::kBusState,
                                           down::kFramesReceived,
                                           down::kFramesSent,
                                           down::kReceiveOverruns,
                                           down::kSendRefused,
                                           down::kBusOffEntries,
                                           down::kFramesForwardedFromHere,
                                           down::kFramesDroppedInForwarding};

void refresh_bus(ObjectDictionary& dictionary, const BusStatusRefs& refs, CanPort& port,
                 std::uint32_t forwarded, std::uint32_t dropped) {
  const BusCounters counters = port.counters();
  dictionary.set(refs.state, static_cast<std::uint8_t>(port.bus_state()));
  dictionary.set(refs.received, counters.received);
  dictionary.set(refs.sent, counters.sent);
  dictionary.set(refs.overruns, counters.receive_overruns);
  dictionary.set(refs.refused, counters.send_refused);
  dictionary.set(refs.bus_off, counters.bus_off_entries);
  dictionary.set(refs.forwarded, forwarded);
  dictionary.set(refs.dropped, dropped);
}

}  // namespace

Node::Node(const NodeConfig& config, const NodeParts& parts)
    : config_(config),
      parts_(parts),
      nmt_(config.node_id),
      emcy_(dictionary_),
      pdos_(dictionary_, parts.upstream.supports_fd() ? kFdPayload : kClassicPayload),
      joints_(dictionary_, parts.compensator, emcy_, config.joint_count, config.clock_us),
      tables_(dictionary_, parts.compensator, parts.store, emcy_, parts.device, parts.buffers),
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
  load_parameters(dictionary_, parts_.parameters);
  emcy_.reset();
  std::array<char, kSerialLength + 1> serial = {};
  std::copy(parts_.device.robot_serial.begin(), parts_.device.robot_serial.end(), serial.begin());
  dictionary_.set_string(od::kRobotSerial, serial.data());
  tables_.start();
  tables_.set_enabled(dictionary_.get(od::compensator_control::kCorrectionEnable) != 0);
  apply_configuration();
  carry_out();
}

void Node::reset_communication(std::uint64_t now_us) {
  now_us_ = now_us;
  joints_.stop();
  dictionary_.restore_communication_defaults(config_.node_id);
  // Saved values are the power-on values (CiA 301, 7.3.2.2.1); those outside the area are live
  // already.
  load_parameters(dictionary_, parts_.parameters);
  emcy_.reset();
  nmt_.begin_initialising();
  apply_configuration();
}

void Node::apply_configuration() {
  dictionary_.set(od::identity_object::kSerialNumber, config_.serial_number);
  for (std::size_t k = 0; k < HeartbeatConsumer::kNodes; ++k) {
    heartbeats_.configure(k, dictionary_.get(od::kConsumerHeartbeatTime[k]));
  }
  pdos_.refresh();
  joints_.configure(pdos_);
  sdo_.reset(kSdoRequestBase + config_.node_id, kSdoResponseBase + config_.node_id);
  tpdos_.restart(now_us_);
  waiting_bits_ = 0;
}

CanPort* Node::inline_output() const {
  return mode() == Mode::kInline ? parts_.downstream : nullptr;
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
  while (const std::uint8_t lost = heartbeats_.process(now_us)) {
    emcy_.raise(Condition::kHeartbeatLost, lost, heartbeats_.slot_of(lost));
    communication_error();
  }
  note_nmt_state();
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
  upstream_watch_.process(now_us_);
  if (downstream_watch_) downstream_watch_->process(now_us_);
}

void Node::note_nmt_state() {
  if (nmt_.state() == known_state_) return;
  // Leaving operational ends the output; entering it begins the timers of the TPDOs.
  if (known_state_ == NmtState::kOperational) joints_.stop();
  if (nmt_.state() == NmtState::kOperational) tpdos_.restart(now_us_);
  if (nmt_.state() == NmtState::kStopped) {
    sdo_.reset(kSdoRequestBase + config_.node_id, kSdoResponseBase + config_.node_id);
  }
  known_state_ = nmt_.state();
}

void Node::carry_out() {
  const auto wanted = static_cast<Mode>(dictionary_.get(od::compensator_control::kMode));
  const bool ends = Nmt::leaves_operational(nmt_command_) || wanted != mode_;
  if (mode_ == Mode::kOffset && nmt_.state() == NmtState::kOperational) {
    if (joints_.fade(now_us_)) outputs_are_fresh();
    if ((ends || joints_.is_leaving()) && joints_.leave()) return;
  }
  if (wanted != mode_) {
    joints_.stop();
    joints_.forget();
    mode_ = wanted;
  }
  if (nmt_command_ == 0) return;
  const NmtRequest request = nmt_.apply(nmt_command_);
  if (request != NmtRequest::kNone) pending_reset_ = request;
  nmt_command_ = 0;
  note_nmt_state();
}

void Node::communication_error() {
  // 0x1029 sub 1: 0 pre-operational (if operational), 1 no change, 2 stopped.
  const std::uint8_t behaviour = dictionary_.get(od::error_behaviour::kCommunicationError);
  if (behaviour == 0 && nmt_.state() == NmtState::kOperational) {
    nmt_command_ = kNmtEnterPreOperational;
  } else if (behaviour == 2) {
    nmt_command_ = kNmtStop;
  }
  carry_out();
}

void Node::handle_upstream(const CanFrame& frame) {
  if (!frame.is(kFrameExtended) && serve(frame)) return;
  const std::size_t number = pdos_.match(frame);
  const bool is_target = number < kRpdos && joints_.carries_target(number);
  if (number < kRpdos) handle_rpdo(number, frame);
  // In inline mode the joint path itself decides whether and when a target goes on.
  if (is_target && mode() == Mode::kInline) return;
  if (parts_.downstream == nullptr) return;
  watch_sdo_targets(frame);
  forward(*parts_.downstream, frame, from_upstream_.forwarded, from_upstream_.dropped);
}

void Node::handle_downstream(CanFrame& frame) {
  if (!frame.is(kFrameExtended)) handle_heartbeat(frame);
  const std::size_t number = pdos_.match(frame);
  if (number < kRpdos && pdos_.rpdo(number).mapping.has_axis_object(kActualPosition)) {
    if (mode() == Mode::kInline) joints_.take_feedback(pdos_.rpdo(number), frame);
  } else if (number < kRpdos && !joints_.carries_target(number)) {
    handle_rpdo(number, frame);
  }
  forward(parts_.upstream, frame, from_downstream_.forwarded, from_downstream_.dropped);
}

void Node::forward(CanPort& to, const CanFrame& frame, std::uint32_t& forwarded,
                   std::uint32_t& dropped) {
  count(to.send(frame) ? forwarded : dropped);
}

bool Node::serve(const CanFrame& frame) {
  if (frame.id == kNmtCommandId) {
    if (const std::uint8_t command = nmt_.command_in(frame); command != 0) nmt_command_ = command;
    carry_out();
    return false;
  }
  if (frame.id == (dictionary_.get(od::kCOBIDSYNCMessage) & kIdMask)) {
    handle_sync(frame);
    return false;
  }
  handle_heartbeat(frame);
  if (frame.id != sdo_.request_id()) return false;
  const NmtState state = nmt_.state();
  if (state == NmtState::kPreOperational || state == NmtState::kOperational) {
    tables_.set_quiet(is_quiet());
    sdo_.handle(frame, now_us_);
  }
  return true;
}

void Node::handle_sync(const CanFrame& frame) {
  const std::uint8_t overflow = dictionary_.get(od::kSynchronousCounterOverflowValue);
  const std::uint8_t expected_length = overflow != 0 ? 1 : 0;
  if (frame.is(kFrameRemote)) return;
  if (frame.len != expected_length) {
    emcy_.raise(Condition::kSyncLength, frame.len);
    return;
  }
  emcy_.clear(Condition::kSyncLength);
  if (nmt_.state() != NmtState::kOperational) return;
  for (std::size_t k = 0; k < kRpdos; ++k) {
    if ((waiting_bits_ >> k & 1U) != 0) take_input(k, waiting_[k]);
  }
  waiting_bits_ = 0;
  if (joints_.on_sync(inline_output(), now_us_)) outputs_are_fresh();
  joints_.note_refused(
      tpdos_.on_sync(parts_.upstream, overflow != 0 ? frame.data[0] : std::uint8_t{0}, now_us_));
}

void Node::handle_heartbeat(const CanFrame& frame) {
  if (frame.id <= kHeartbeatBase || frame.id > kHeartbeatBase + kMaxNodeId) return;
  if (const std::uint8_t back = heartbeats_.handle(frame, now_us_); back != 0) {
    emcy_.clear(Condition::kHeartbeatLost, heartbeats_.slot_of(back));
  }
}

void Node::handle_rpdo(std::size_t number, const CanFrame& frame) {
  if (joints_.carries_target(number)) joints_.note_command(now_us_);
  const Pdo& pdo = pdos_.rpdo(number);
  const bool is_feedback = pdo.mapping.has_axis_object(kActualPosition);
  // Actual positions are heard in every state: the first set has to know what the drives hold.
  if (!is_feedback && nmt_.state() != NmtState::kOperational) return;
  if (joints_.carries_target(number)) {
    if (mode() == Mode::kForward) return;
    if (joints_.take_target(pdo, number, frame, inline_output(), now_us_)) outputs_are_fresh();
    return;
  }
  if (frame.len < pdo.mapping.length) {
    short_rpdo_ = number;
    emcy_.raise(Condition::kPdoLength, frame.id);
    return;
  }
  if (number == short_rpdo_) {
    short_rpdo_ = kRpdos;
    emcy_.clear(Condition::kPdoLength);
  }
  if (is_feedback) {
    // Not ours to change on the way; 0x6064 and the TPDOs that carry it give it without the
    // correction.
    CanFrame copy = frame;
    return joints_.take_feedback(pdo, copy);
  }
  if (pdo.is_synchronous()) {
    waiting_[number] = frame;
    waiting_bits_ |= 1U << number;
  } else {
    take_input(number, frame);
  }
}

void Node::take_input(std::size_t number, const CanFrame& frame) {
  const Pdo& pdo = pdos_.rpdo(number);
  apply_rpdo(dictionary_, pdo, frame);
  for (const MappedEntry& mapped : pdo.mapping.used()) {
    if (mapped.index == od::kTemperatureInputs[0].index) {
      joints_.note_temperature(mapped.sub - 1U, now_us_);
    }
  }
}

void Node::outputs_are_fresh() {
  if (mode() != Mode::kOffset) return;
  joints_.note_refused(tpdos_.on_fresh_outputs(parts_.upstream, now_us_, joints_.is_leaving()));
}

void Node::watch_sdo_targets(const CanFrame& frame) {
  const bool to_a_node = frame.id > kSdoRequestBase && frame.id <= kSdoRequestBase + kMaxNodeId;
  if (frame.is(kFrameExtended) || !to_a_node || frame.len != 8) return;
  if (mode() != Mode::kInline || (frame.data[0] & 0xE0U) != 0x20U) return;
  if (axis_object(load_le<std::uint16_t>(&frame.data[1])) != kTargetPosition) return;
  count(sdo_targets_);
  emcy_.raise(Condition::kTargetBySdo, frame.id - kSdoRequestBase);
}

void Node::refresh_status() {
  namespace status = od::compensator_status;
  const JointCounters& joints = joints_.counters();
  const CycleCounters& cycles = parts_.compensator.counters();
  const std::uint64_t clamped =
      std::uint64_t{cycles.magnitude_clamped} + cycles.rate_clamped + cycles.output_saturated;
  dictionary_.set(status::kState, static_cast<std::uint8_t>(parts_.compensator.state()));
  std::uint32_t bits = 0;
  bits |= joints_.is_configured() ? 1U << 0 : 0U;
  bits |= joints_.is_streaming() ? 1U << 1 : 0U;
  bits |= tables_.on_trial() ? 1U << 2 : 0U;
  bits |= is_quiet() ? 1U << 3 : 0U;
  bits |= joints_.knows_drives() ? 0U : 1U << 4;
  bits |= has_unsaved_ ? 1U << 5 : 0U;
  dictionary_.set(status::kStatusBits, bits);
  dictionary_.set(od::kManufacturerStatusRegister, bits);
  dictionary_.set(status::kCycles, joints.sets);
  dictionary_.set(status::kClamped,
                  static_cast<std::uint32_t>(std::min<std::uint64_t>(clamped, UINT32_MAX)));
  for (std::size_t k = 0; k < kAxes; ++k) {
    dictionary_.set(od::kClampedCyclesByAxis[k], cycles.clamped[k]);
  }
  dictionary_.set(status::kStale, joints.stale);
  dictionary_.set(status::kRefused, tables_.refused() + access_.refused_writes());
  dictionary_.set(status::kWorstCycle, joints.worst_cycle_us);
  dictionary_.set(status::kSetsWithheld, joints.withheld);
  dictionary_.set(status::kRepeatedFrames, joints.repeated);
  dictionary_.set(status::kMalformedFrames, joints.malformed);
  dictionary_.set(status::kTargetsSeenBySDO, sdo_targets_);
  dictionary_.set(status::kJointCount, config_.joint_count);
  dictionary_.set(status::kTimeSinceStart, static_cast<std::uint32_t>(milliseconds_of(now_us_)));
  dictionary_.set(status::kOutputFramesRefusedByTheBus, joints.output_refused);
  dictionary_.set(status::kContradictingTargets, joints.conflicts);
  dictionary_.set(status::kCorrectionClampBits, joints_.last_flags());
}

Abort Node::before_read(std::uint16_t index, std::uint8_t sub) {
  // A bus's state and the errors that it raises are read in one turn: they must agree.
  watch_buses();
  if (index == od::kPreDefinedErrorField[0].index) {
    // A field that holds no error is not readable (CiA 301, 7.5.2.4).
    const bool is_held = sub <= dictionary_.get(od::kPreDefinedErrorFieldCount);
    return is_held ? Abort::kNone : Abort::kNoData;
  }
  if (index == od::compensator_status::kState.index || index == od::kClampedCyclesByAxis[0].index ||
      index == od::kManufacturerStatusRegister.index) {
    refresh_status();
  } else if (index == kUpstreamRefs.state.index) {
    refresh_bus(dictionary_, kUpstreamRefs, parts_.upstream, from_upstream_.forwarded,
                from_upstream_.dropped);
  } else if (index == kDownstreamRefs.state.index && parts_.downstream != nullptr) {
    refresh_bus(dictionary_, kDownstreamRefs, *parts_.downstream, from_downstream_.forwarded,
                from_downstream_.dropped);
  } else if (index == od::table_status::kStagingState.index) {
    tables_.refresh_status();
  }
  return Abort::kNone;
}

}  // namespace armtrue::canopen
