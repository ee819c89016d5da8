// Brings status objects up to date when they are read.
#include <algorithm>
#include <initializer_list>

#include "firmware/canopen/node/node.h"

namespace armtrue::canopen {
namespace {

namespace up = od::upstream_bus_status;
namespace down = od::downstream_bus_status;

// Sets consecutive values of the dictionary, beginning with `ref`.
void set_run(ObjectDictionary& dictionary, od::Ref<std::uint32_t> ref,
             std::initializer_list<std::uint32_t> values) {
  for (const std::uint32_t value : values) {
    dictionary.set(ref, value);
    ref.offset = static_cast<std::uint16_t>(ref.offset + sizeof value);
  }
}

}  // namespace

// Both bus records have the same layout: the state, then counters.
void Node::refresh_bus(CanPort& port, const Forwarding& from, od::Ref<std::uint8_t> state,
                       od::Ref<std::uint32_t> received) {
  const BusCounters counters = port.counters();
  dictionary_.set(state, static_cast<std::uint8_t>(port.bus_state()));
  set_run(dictionary_, received,
          {counters.received, counters.sent, counters.receive_overruns, counters.send_refused,
           counters.bus_off_entries, from.forwarded, from.dropped});
}

void Node::refresh_status() {
  namespace status = od::compensator_status;
  const JointCounters& joints = joints_.counters();
  const CycleCounters& cycles = parts_.compensator.counters();
  const std::uint64_t clamped =
      std::uint64_t{cycles.magnitude_clamped} + cycles.rate_clamped + cycles.output_saturated;
  dictionary_.set(status::kState, static_cast<std::uint8_t>(parts_.compensator.state()));
  std::uint32_t bits = 0;
  bits |= joints_.is_configured() ? 1U : 0U;
  bits |= joints_.is_streaming() ? 1U << 1 : 0U;
  bits |= tables_.on_trial() ? 1U << 2 : 0U;
  bits |= is_quiet() ? 1U << 3 : 0U;
  bits |= joints_.knows_drives() ? 0U : 1U << 4;
  bits |= has_unsaved_ ? 1U << 5 : 0U;
  dictionary_.set(od::kManufacturerStatusRegister, bits);
  set_run(
      dictionary_, status::kStatusBits,
      {bits, joints.sets, static_cast<std::uint32_t>(std::min<std::uint64_t>(clamped, UINT32_MAX)),
       joints.stale, tables_.refused() + access_.refused_writes(), joints.worst_cycle_us,
       joints.withheld, joints.repeated, joints.malformed, sdo_targets_});
  for (std::size_t k = 0; k < kAxes; ++k) {
    dictionary_.set(od::kClampedCyclesByAxis[k], cycles.clamped[k]);
  }
  dictionary_.set(status::kJointCount, config_.joint_count);
  dictionary_.set(status::kTimeSinceStart, static_cast<std::uint32_t>(now_us_ / 1000));
  dictionary_.set(status::kOutputFramesRefusedByTheBus, joints.output_refused);
  dictionary_.set(status::kContradictingTargets, joints.conflicts);
  dictionary_.set(status::kCorrectionClampBits, joints_.last_flags());
}

void Node::refresh_drive_states() {
  namespace states = od::drive_states;
  const JointCounters& joints = joints_.counters();
  dictionary_.set(states::kAxesWhoseStateIsKnown, joints_.drives().known());
  dictionary_.set(states::kAxesThatDoNotFollow, joints_.axes_away());
  dictionary_.set(states::kPhase, static_cast<std::uint8_t>(joints_.phase()));
  dictionary_.set(states::kWhySuspended, joints_.suspension());
  set_run(dictionary_, states::kSuspensions,
          {joints.suspended, joints.resumed, joints.reference_changes});
}

void Node::refresh_timing() {
  namespace timing = od::timing;
  const auto put = [this](od::Ref<std::uint32_t> minimum, const Latency& latency) {
    set_run(dictionary_, minimum,
            {latency.least(), latency.quantile(500), latency.quantile(999), latency.most()});
  };
  put(timing::kSYNCLatencyMinimum, sync_latency_);
  put(timing::kSYNCJitterMinimum, sync_jitter_);
  put(timing::kTargetLatencyMinimum, joints_.target_latency());
  dictionary_.set(timing::kSetWindowInForce, joints_.window_us());
}

void Node::refresh_health() {
  namespace refs = od::start_and_supply;
  if (parts_.health == nullptr) return;
  const PortHealth& health = *parts_.health;
  dictionary_.set(refs::kCauseOfTheLastReset, health.reset_cause);
  set_run(dictionary_, refs::kStartsSincePowerOn,
          {health.starts, health.history, health.fault_instruction, health.fault_status,
           health.fault_address, health.option_bytes, health.protection, health.supply_dips});
}

Abort Node::before_read(std::uint16_t index, std::uint8_t sub) {
  // A client may read a bus state and its errors in one turn; they must agree.
  watch_buses();
  if (index == od::kPreDefinedErrorField[0].index) {
    // A field that holds no error is not readable (CiA 301, 7.5.2.4).
    const bool is_held = sub <= dictionary_.get(od::kPreDefinedErrorFieldCount);
    return is_held ? Abort::kNone : Abort::kNoData;
  }
  switch (index) {
    case od::start_and_supply::kOptionBytes.index:
      refresh_health();
      break;
    case od::drive_states::kPhase.index:
      refresh_drive_states();
      break;
    case od::timing::kSetWindowInForce.index:
      refresh_timing();
      break;
    case od::compensator_status::kState.index:
    case od::kClampedCyclesByAxis[0].index:
    case od::kManufacturerStatusRegister.index:
      refresh_status();
      break;
    case up::kBusState.index:
      refresh_bus(parts_.upstream, from_upstream_, up::kBusState, up::kFramesReceived);
      break;
    case down::kBusState.index:
      if (parts_.downstream == nullptr) break;
      refresh_bus(*parts_.downstream, from_downstream_, down::kBusState, down::kFramesReceived);
      break;
    case od::table_status::kStagingState.index:
      tables_.refresh_status();
      break;
    default:
      break;
  }
  return Abort::kNone;
}

}  // namespace armtrue::canopen
