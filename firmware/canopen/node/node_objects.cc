// Checks and effects of writing an object, beyond storing its value.
#include <algorithm>
#include <utility>

#include "firmware/canopen/node/node.h"
#include "firmware/canopen/protocol/cob_id.h"
#include "firmware/canopen/protocol/crc16.h"
#include "firmware/core/crypto/crc32.h"

namespace armtrue::canopen {
namespace {

constexpr std::uint32_t kSave = 0x65766173;  // "save"
constexpr std::uint32_t kLoad = 0x64616F6C;  // "load"
constexpr std::uint32_t kSyncProducer = 0x40000000;

template <typename T>
bool is(const od::Entry& entry, const od::Ref<T>& ref) {
  return entry.index == ref.index && entry.sub == ref.sub;
}

constexpr std::uint16_t kPositionRangeLimit = 0x607B;
constexpr std::uint16_t kSoftwarePositionLimit = 0x607D;
constexpr std::uint16_t kEncoderResolution = 0x608F;

// Bits of 0x2030.
enum SelfTest : std::uint8_t {
  kTestChecksums = 1U << 0,
  kTestDictionary = 1U << 1,
  kTestTable = 1U << 2,
  kTestBuses = 1U << 3,
  kTestPassThrough = 1U << 4,
};
constexpr std::uint8_t kAllTests = 0x1F;

// Whether `entry` is the COB-ID of SYNC, or the COB-ID or mapping of a PDO: these decide which
// frames are targets, actual positions or offsets, and which pass unchanged.
bool moves_frames(const od::Entry& entry) {
  if (entry.index < 0x1400) return is(entry, od::kCOBIDSYNCMessage);
  const bool is_mapping = (entry.index & 0x0200U) != 0;  // 0x16xx and 0x1Axx
  return is_mapping || entry.sub == 1;
}

bool checksums_are_right() {
  // The check values that both CRC catalogues give for this text.
  constexpr std::uint8_t kText[] = {'1', '2', '3', '4', '5', '6', '7', '8', '9'};
  return crc16(kText) == 0x31C3 && crc32(kText) == 0xCBF43926U;
}

bool dictionary_is_ordered() {
  return std::ranges::is_sorted(
      od::kEntries, {}, [](const od::Entry& entry) { return std::pair(entry.index, entry.sub); });
}

}  // namespace

Abort Node::check_communication_write(const od::Entry& entry, std::span<const std::uint8_t> value) {
  const std::uint32_t wanted = load_le(value);
  const bool is_sync = is(entry, od::kCOBIDSYNCMessage);
  const bool is_sync_counter = is(entry, od::kSynchronousCounterOverflowValue);
  const bool is_pdo_parameter = entry.index >= 0x1400;
  if ((is_sync || is_sync_counter || is_pdo_parameter) && mode() != Mode::kForward) {
    // A starting controller may reconfigure in pre-operational, where no set goes out.
    const bool is_held =
        moves_frames(entry) && nmt_.state() == NmtState::kOperational && holds_correction();
    if (is_held || !is_quiet()) return Abort::kDeviceState;
  }
  if (is_sync) {
    // This node consumes SYNC; it does not produce it.
    const bool possible = (wanted & (kSyncProducer | kExtended | kReservedIdBits)) == 0 &&
                          !is_restricted_id(wanted & kIdMask);
    if (!possible) return Abort::kValueRange;
    return pdos_.has_id(wanted & kIdMask) ? Abort::kIncompatibleParameter : Abort::kNone;
  }
  if (is_sync_counter) {
    return wanted == 1 ? Abort::kValueRange : Abort::kNone;  // reserved (CiA 301, 7.5.2.22)
  }
  if (is(entry, od::kCOBIDEMCY)) {
    const std::uint32_t present = dictionary_.get(od::kCOBIDEMCY);
    if ((wanted & (kExtended | kReservedIdBits)) != 0 || is_restricted_id(wanted & kIdMask)) {
      return Abort::kValueRange;
    }
    // While valid, only validity changes (CiA 301, 7.5.2.17).
    const bool moves = (present & kIdMask) != (wanted & kIdMask);
    return (present & kInvalid) == 0 && moves ? Abort::kValueRange : Abort::kNone;
  }
  if (entry.index == od::kConsumerHeartbeatTime[0].index && entry.sub > 0) {
    const std::uint32_t node_id = wanted >> 16 & 0xFFU;
    if ((wanted & 0xFF000000U) != 0 || node_id > 127) return Abort::kIncompatibleParameter;
    if (node_id == 0 || (wanted & 0xFFFFU) == 0) return Abort::kNone;
    for (std::size_t k = 0; k < HeartbeatConsumer::kNodes; ++k) {
      const std::uint32_t other = dictionary_.get(od::kConsumerHeartbeatTime[k]);
      const bool watched = (other >> 16 & 0xFFU) == node_id && (other & 0xFFFFU) != 0;
      if (watched && k + 1 != entry.sub) return Abort::kIncompatibleParameter;
    }
    return Abort::kNone;
  }
  if (is(entry, od::store_parameters::kSaveAllParameters)) {
    if (wanted != kSave) return Abort::kCannotStore;
    if (!is_quiet() || !may_erase(0)) return Abort::kDeviceState;
    return save_parameters(dictionary_, parts_.parameters) ? Abort::kNone : Abort::kHardware;
  }
  if (is(entry, od::restore_default_parameters::kRestoreAllDefaultParameters)) {
    if (wanted != kLoad) return Abort::kCannotStore;
    if (!is_quiet() || !may_erase(0)) return Abort::kDeviceState;
    return parts_.parameters.erase() ? Abort::kNone : Abort::kHardware;
  }
  const Abort abort = check_pdo_write(dictionary_, entry, value, pdos_.payload_max());
  const bool switches_on = is_pdo_parameter && (entry.index & 0x0200U) == 0 && entry.sub == 1 &&
                           (wanted & kInvalid) == 0;
  if (abort != Abort::kNone || !switches_on) return abort;
  return pdos_.may_switch_on(entry.index, wanted & kIdMask) ? Abort::kNone
                                                            : Abort::kIncompatibleParameter;
}

// Whether every drive has none of this node's corrections: then an uncorrected target is no step,
// and no offset stays in a drive.
bool Node::is_free_of_correction() const {
  return joints_.phase() == Phase::kUnknown ||
         parts_.compensator.state() == CompensatorState::kPassThrough;
}

// Whether an enabled drive holds a correction.
bool Node::holds_correction() const { return !is_free_of_correction() && !all_say_disabled(); }

bool Node::all_say_disabled(std::uint8_t passive) const {
  const std::uint32_t all = joints_.axes_with_drives() & ~std::uint32_t{passive};
  return (joints_.drives().disabled() & all) == all;
}

// Whether all drives are disabled or silent. While frames come from downstream, or actual positions
// from either bus, a drive counts as enabled unless its statusword reports it disabled. A drive
// that has reported another state counts as in this state, however long it has been silent.
bool Node::drives_are_off(std::uint8_t passive) const {
  const DriveStates& drives = joints_.drives();
  if ((drives.known() & ~drives.disabled()) != 0) return false;
  const bool hears_downstream =
      has_heard_drives_ && now_us_ - drives_heard_us_ <= DriveStates::kSilentUs;
  const bool is_silent = !hears_downstream && !drives.is_speaking(now_us_);
  return is_silent || all_say_disabled(passive);
}

// An erase stalls the core for seconds on some ports: neither the joint path nor the heartbeat runs
// meanwhile, and nothing is forwarded.
bool Node::may_erase(std::uint8_t passive) const { return drives_are_off(passive); }

// While the phase is unknown, enabled drives may hold a correction from before the start.
bool Node::may_change_axes(std::uint8_t passive) const {
  return is_free_of_correction() && drives_are_off(passive);
}

// Resolution, ranges and limits may change only without a correction, at rest, and with the drives
// disabled or silent: a change of scale under a correction would be a step, and the limits are
// valid in the drives' own scale only.
bool Node::may_change_resolution() const {
  return is_quiet() && drives_are_off(0) &&
         parts_.compensator.state() == CompensatorState::kPassThrough;
}

Abort Node::before_write(const od::Entry& entry, std::span<const std::uint8_t> value) {
  const std::uint64_t begin_us = config_.clock_us();
  const Abort abort = check_write(entry, value);
  // Heartbeats that arrive while an erase stalls the core are lost, though their senders sent them.
  heartbeats_.excuse(config_.clock_us() - begin_us);
  return abort;
}

Abort Node::check_write(const od::Entry& entry, std::span<const std::uint8_t> value) {
  if (entry.index < 0x2000) return check_communication_write(entry, value);
  if (is(entry, od::kTableCommand)) return tables_.command(load_le(value), is_quiet());
  namespace control = od::compensator_control;
  if (is(entry, control::kMode)) {
    const auto wanted = static_cast<Mode>(value[0]);
    // Inline mode needs the drives downstream, offset mode upstream.
    if ((wanted == Mode::kInline && parts_.downstream == nullptr) ||
        (wanted == Mode::kOffset && joints_.drives_are_downstream())) {
      return Abort::kIncompatibleParameter;
    }
    // Offset mode needs no such check: its offsets fade to zero before it ends.
    const bool leaves_inline = mode() == Mode::kInline && wanted != mode();
    const bool may_leave = !leaves_inline || !holds_correction();
    return is_quiet() && may_leave ? Abort::kNone : Abort::kDeviceState;
  }
  if (is(entry, control::kFeedbackDelay)) return is_quiet() ? Abort::kNone : Abort::kDeviceState;
  const std::uint16_t object = axis_object(entry.index);
  const bool is_bound = object == kPositionRangeLimit || object == kSoftwarePositionLimit;
  if (object == kEncoderResolution || is_bound) {
    return may_change_resolution() ? Abort::kNone : Abort::kDeviceState;
  }
  if (is(entry, control::kCorrectionEnable)) {
    // Disabling is always allowed; enabling checks the table again, which takes too long in motion.
    if (value[0] == 0) return Abort::kNone;
    return is_quiet() ? tables_.check_enable() : Abort::kDeviceState;
  }
  if (is(entry, od::self_test::kRun)) {
    if ((value[0] & ~kAllTests) != 0 || value[0] == 0) return Abort::kValueRange;
    return is_quiet() ? Abort::kNone : Abort::kDeviceState;
  }
  return Abort::kNone;
}

void Node::after_write(const od::Entry& entry) {
  if ((entry.flags & od::kStored) != 0) has_unsaved_ = true;
  if (is(entry, od::kPreDefinedErrorFieldCount)) return emcy_.clear_history();
  if (is(entry, od::kProducerHeartbeatTime)) return nmt_.restart_heartbeat(now_us_);
  if (entry.index == od::kConsumerHeartbeatTime[0].index) {
    const std::size_t slot = entry.sub - 1U;
    emcy_.clear(Condition::kHeartbeatLost, slot);  // of the node that the slot watched before
    return heartbeats_.configure(slot, dictionary_.get(od::kConsumerHeartbeatTime[slot]));
  }
  if (is(entry, od::store_parameters::kSaveAllParameters)) {
    has_unsaved_ = false;
    // Reads back as "saves on command".
    return dictionary_.set(od::store_parameters::kSaveAllParameters, 1U);
  }
  if (is(entry, od::restore_default_parameters::kRestoreAllDefaultParameters)) {
    has_unsaved_ = true;
    return dictionary_.set(od::restore_default_parameters::kRestoreAllDefaultParameters, 1U);
  }
  if (entry.index >= 0x1400 && entry.index < 0x1C00) {
    configure_pdos();
    waiting_count_ = 0;  // frames that wait for SYNC came with the old mappings
    return tpdos_.restart(now_us_);
  }
  namespace control = od::compensator_control;
  if (is(entry, control::kMode)) return carry_out();
  if (is(entry, control::kCorrectionEnable)) {
    joints_.accept_reference();
    return tables_.set_enabled(dictionary_.get(control::kCorrectionEnable) != 0);
  }
  if (entry.index >= 0x6000) return joints_.configure_bounds();
  if (is(entry, od::self_test::kRun)) run_self_test(dictionary_.get(od::self_test::kRun));
  joints_.note_input(entry.index, entry.sub, now_us_);
}

void Node::run_self_test(std::uint8_t tests) {
  std::uint32_t failed = 0;
  if ((tests & kTestChecksums) != 0 && !checksums_are_right()) failed |= kTestChecksums;
  if ((tests & kTestDictionary) != 0 && !dictionary_is_ordered()) failed |= kTestDictionary;
  if ((tests & kTestTable) != 0 && !tables_.active_is_sound()) failed |= kTestTable;
  if ((tests & kTestBuses) != 0) {
    const bool downstream_off =
        parts_.downstream != nullptr && parts_.downstream->bus_state() == BusState::kBusOff;
    if (parts_.upstream.bus_state() == BusState::kBusOff || downstream_off) failed |= kTestBuses;
  }
  if ((tests & kTestPassThrough) != 0) {
    // In pass-through every position offset must be zero.
    const bool passes = parts_.compensator.state() == CompensatorState::kPassThrough;
    for (std::size_t axis = 0; passes && axis < config_.joint_count; ++axis) {
      if (dictionary_.get(od::axis::kPositionOffset[axis]) != 0) failed |= kTestPassThrough;
    }
  }
  dictionary_.set(od::self_test::kTestsRun, static_cast<std::uint32_t>(tests));
  dictionary_.set(od::self_test::kTestsFailed, failed);
}

}  // namespace armtrue::canopen
