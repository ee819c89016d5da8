// From target frames to corrected targets, and from actual positions back.
//
// SetAssembler says which frames are a set; a set is corrected when its last frame is here, and
// only then. Asynchronous targets (254, 255) leave at once. Synchronous ones (0 to 240) are
// corrected and held; SYNC takes them along, unless they were contradicted meanwhile: then the
// correction is taken back. After the stale time-out without a set the stream counts as interrupted
// and EMCY 0xFF10 is raised; targets that come without a set that goes out for kWithheldUs are EMCY
// 0xFF15.
//
// A correction moves by what has reached its drive: what a bus refused, or what still waits for
// SYNC when the next is computed, is taken back for its joints, and they go on from what they hold.
//
//   inline   the frames of the set are held, their target bytes rewritten, and released
//            downstream in the order in which they came; all other bytes are untouched
//   offset   0x60B0 of every axis is set and the TPDOs that carry it are sent; the frames
//            themselves are none of our business
//
// What the drives hold is followed through four phases (Phase below). After a start or a change of
// mode nobody here knows what it is. Once all actual positions have been heard, the first set
// begins with the difference from its targets, as far as the table permits a correction, and blends
// from there. In offset mode the drives follow the controller by themselves, and an arm in motion
// differs by its following error as well: nothing goes out until it has stood for kRestUs where the
// difference is permitted. Where not all have been heard a correction begins at zero.
#ifndef ARMTRUE_FIRMWARE_CANOPEN_MOTION_JOINT_PATH_H_
#define ARMTRUE_FIRMWARE_CANOPEN_MOTION_JOINT_PATH_H_

#include <array>
#include <cstddef>
#include <cstdint>

#include "firmware/canopen/motion/drive_states.h"
#include "firmware/canopen/motion/latency.h"
#include "firmware/canopen/motion/sensor_inputs.h"
#include "firmware/canopen/motion/set_assembler.h"
#include "firmware/canopen/protocol/can_port.h"
#include "firmware/canopen/protocol/emcy.h"
#include "firmware/canopen/protocol/object_dictionary.h"
#include "firmware/canopen/protocol/pdo.h"
#include "firmware/core/compensator.h"

namespace armtrue::canopen {

// 0x2000 sub 1.
enum class Mode : std::uint8_t { kForward = 0, kInline = 1, kOffset = 2 };

// What the drives hold, and what becomes of it.
enum class Phase : std::uint8_t {
  kUnknown,     // nothing has gone out: they hold what somebody else gave them
  kCorrecting,  // the correction that is right, or on its way there
  kSuspended,   // on its way to zero, or there, while a drive does not follow
  kLeaving,     // on its way to zero, and nothing will follow
};

// Why a correction is suspended, 0x2005 sub 4. Bits.
enum Suspension : std::uint8_t {
  kSuspendedNot = 0,
  kSuspendedAxisAway = 1U << 0,
  kSuspendedReference = 1U << 1,  // an encoder's zero was changed; until the correction is disabled
};

// Information of EMCY 0xFF15: why sets do not go out.
enum WhyWithheld : std::uint32_t {
  kFramesMissing = 1,    // no set of targets was complete within the set window
  kContradictions = 2,   // contradicted or short frames
  kPositionUnknown = 3,  // offset mode: the arm has not stood yet where its offset is known
  kSyncMissing = 4,      // targets or offsets that wait for SYNC, which does not come
  kNoSet = 5,            // targets make no set: too few joints, or an axis mapped twice
  kNotOperational = 6,
  kOutputRefused = 7,  // the bus did not take the set, or its offsets
};

// How the drives' offsets leave, from the mappings of TPDOs.
enum class OffsetOutput : std::uint8_t { kAtOnce, kWithSync };

// What the joint path counts; the compensator counts the rest.
struct JointCounters {
  std::uint32_t sets = 0;       // complete sets that went out
  std::uint32_t steps = 0;      // of the correction: those sets, and the way to zero without any
  std::uint32_t stale = 0;      // times the stream was interrupted
  std::uint32_t withheld = 0;   // sets that did not go out: a frame missing, late or contradicted
  std::uint32_t repeated = 0;   // frames dropped because the set had them already
  std::uint32_t malformed = 0;  // PDOs shorter than their mapping
  std::uint32_t conflicts = 0;  // targets that contradict others of the same SYNC interval
  std::uint32_t output_refused = 0;  // frames that the downstream port did not take
  std::uint32_t worst_cycle_us = 0;
  std::uint32_t suspended = 0;
  std::uint32_t resumed = 0;
  std::uint32_t reference_changes = 0;
};

class JointPath {
 public:
  // `downstream`: where inline output goes; nullptr on one bus, where inline is no mode.
  JointPath(ObjectDictionary& dictionary, Compensator& compensator, Emcy& emcy, CanPort* downstream,
            std::uint8_t joint_count, std::uint64_t (*clock_us)());

  // Decides from the mappings which RPDOs make a set. Drops a set in the making.
  void configure(const PdoTable& pdos);
  // Takes ranges and limits of positions from the dictionary.
  void configure_bounds();

  // Another mode: what the drives hold is not known any more.
  void set_mode(Mode mode);
  Mode mode() const { return mode_; }

  // Whether every joint with a drive is mapped in the target RPDOs, and in offset mode its offset
  // in the TPDOs and the drives where those go. Without that nothing is ever evaluated.
  bool is_configured() const;
  // Bit k is set if axis k has a drive. Before the first table all axes count as having one.
  std::uint32_t axes_with_drives() const;
  // Whether this RPDO is one of the set.
  bool carries_target(std::size_t rpdo) const {
    return is_configured() && sets_.carries_target(rpdo);
  }

  // Takes a target frame. Returns true if outputs are fresh.
  bool take_target(const Pdo& pdo, std::size_t rpdo, const CanFrame& frame, std::uint64_t now_us);

  // SYNC divides sets and takes along one that waits for it. Returns true if outputs are fresh.
  bool on_sync(std::uint64_t now_us);

  // What drives say of themselves in a frame: state, mode of operation, offset.
  void hear(const Pdo& pdo, const CanFrame& frame);

  // Rewrites the actual positions in a frame from the drives, by the correction that was in force;
  // before the first set there is none.
  void take_feedback(const Pdo& pdo, CanFrame& frame, std::uint64_t now_us);

  // An actual position came from downstream: that is where the drives are, unless offset mode knows
  // them upstream already. Until the restart.
  void note_drives_downstream() {
    if (mode_ != Mode::kOffset || !knows_drives()) drives_are_downstream_ = true;
  }
  // Whether the drives are on the downstream port. Offsets are sent on the upstream one, where they
  // would not receive them.
  bool drives_are_downstream() const { return drives_are_downstream_; }

  // Windows and time-outs. Returns whether the supervision is sound, which is what feeds the
  // watchdog: the last call was at most kSupervisionUs ago, and no stream went on without a set for
  // that much longer than the stale time-out.
  bool process(std::uint64_t now_us);
  static constexpr std::uint64_t kSupervisionUs = 100'000;

  // Output stops, the set in the making is dropped: NMT left operational, a reset, a mode change.
  void stop();

  // The drives' offsets are to become zero because nothing will follow. True while they are on
  // their way, which ends after kLeaveUs at the latest; then what they hold counts as forgotten.
  // Call until it is false.
  bool leave(std::uint64_t now_us);
  bool is_leaving() const { return phase_ == Phase::kLeaving; }
  static constexpr std::uint64_t kLeaveUs = 5'000'000;

  // Takes the next step towards zero where no stream of targets does. True if outputs are fresh.
  bool fade(std::uint64_t now_us);

  // The correction was disabled or is of a new table: a change of an encoder's zero is somebody's
  // responsibility now.
  void accept_reference();

  // Whether the correction began with what the drives were heard to hold.
  bool knows_drives() const { return phase_ != Phase::kUnknown && began_with_heard_; }
  Phase phase() const { return phase_; }
  const DriveStates& drives() const { return drives_; }
  std::uint8_t suspension() const;

  // A target frame is on the bus, whatever becomes of it: tables are not changed now, and in
  // inline mode somebody waits for its set.
  void note_command(std::uint64_t now_us);
  // Microseconds since the last target frame; a large number before the first.
  std::uint64_t quiet_us(std::uint64_t now_us) const {
    return seen_target_ ? now_us - last_target_us_ : UINT64_MAX;
  }

  // What became of the offsets since outputs were fresh, or with SYNC: how many frames the bus
  // refused, and whose newest offset has not left (bit k: axis k).
  void note_offsets(std::uint32_t refused, std::uint32_t unsent, std::uint64_t now_us);

  // Takes every value of a PDO into the dictionary, whatever it is mapped beside. Precondition:
  // frame.len >= pdo.mapping.length.
  void take_input(const Pdo& pdo, const CanFrame& frame, std::uint64_t now_us);

  // An object has been written by SDO: a temperature or the payload counts as given.
  void note_input(std::uint16_t index, std::uint8_t sub, std::uint64_t now_us) {
    inputs_.note(index, sub, now_us);
  }

  bool is_streaming() const { return streaming_; }
  std::uint16_t last_flags() const { return last_flags_; }
  const JointCounters& counters() const { return counters_; }
  std::uint32_t window_us() const { return sets_.window_us(configured_window_us()); }
  // From a set's last frame to its last corrected one, asynchronous targets, µs.
  const Latency& target_latency() const { return target_latency_; }

 private:
  std::uint32_t configured_window_us() const {
    return dictionary_.get(od::compensator_control::kSetWindow);
  }
  std::uint32_t stale_us() const { return dictionary_.get(od::compensator_control::kStaleTimeOut); }
  void end_interval();
  void take_back();
  void take_back_unsent();
  void spoil(Condition condition, std::uint32_t information, std::uint32_t& counter);
  bool compute(std::uint64_t now_us);
  bool begin(std::uint64_t now_us);
  bool release(std::uint64_t now_us);
  void note_set_out(std::uint64_t now_us);
  std::size_t send_set();
  bool is_kept_from_sync() const;
  void publish();
  void follow_drives();
  void read_targets(std::uint64_t now_us);
  void read_surroundings(std::uint64_t now_us);
  void check_offset(std::size_t axis, std::int32_t offset);
  void interrupted();
  void forget();
  void watch_stream(std::uint64_t now_us);
  std::uint32_t why_withheld() const;

  // Sets without a contradiction or a short frame after which the condition is over.
  static constexpr std::uint32_t kCleanSets = 100;
  // Following errors are over when the targets have stood for so long.
  static constexpr std::uint32_t kRestUs = 100'000;
  // Targets that come for so long without a set that goes out are reported.
  static constexpr std::uint64_t kWithheldUs = 100'000;
  // Offsets read back in a row that are none of those sent lately before that is reported.
  static constexpr std::uint32_t kStrangeOffsets = 20;

  ObjectDictionary& dictionary_;
  Compensator& compensator_;
  Emcy& emcy_;
  CanPort* downstream_;
  std::uint64_t (*clock_us_)();
  std::uint8_t joint_count_;

  SetAssembler sets_;
  DriveStates drives_;
  SensorInputs inputs_;
  OffsetOutput offset_output_ = OffsetOutput::kAtOnce;
  std::uint32_t offset_axes_ = 0;  // bit k: the offset of axis k is mapped
  Mode mode_ = Mode::kForward;
  Phase phase_ = Phase::kUnknown;
  // Whether the first correction starts from what the drives reported (else from zero); set by
  // begin().
  bool began_with_heard_ = false;
  bool reference_changed_ = false;
  bool drives_are_downstream_ = false;
  std::uint32_t heard_ = 0;  // bit k: the actual position of axis k came in phase kUnknown
  std::uint32_t clean_sets_ = 0;

  CycleInput input_;    // its targets stand since resting_since_us_
  CycleOutput output_;  // of the set that was computed last
  std::uint32_t last_cycle_ = 0;
  std::uint32_t first_cycle_ = 0;
  std::uint64_t computed_us_ = 0;   // when output_ was
  std::uint64_t last_step_us_ = 0;  // the same of the last that went out
  std::uint64_t resting_since_us_ = 0;
  std::uint64_t leaving_since_us_ = 0;
  std::array<std::uint32_t, kMaxJoints> strange_offsets_ = {};
  std::uint16_t last_flags_ = 0;
  bool streaming_ = false;
  bool seen_target_ = false;
  bool is_refused_ = false;     // the last set, or some of it, by the bus of the drives
  bool is_offset_set_ = false;  // the last set went into offsets, of which nothing is noted yet
  std::uint8_t unsent_ = 0;     // bit k: what was put out last has not reached the drive of joint k
  std::uint64_t last_target_us_ = 0;
  std::uint64_t last_taken_us_ = 0;     // the last that was to be corrected
  std::uint64_t waiting_since_us_ = 0;  // since when targets come and no set has gone out
  std::uint64_t last_set_us_ = 0;
  std::uint64_t last_process_us_ = 0;
  JointCounters counters_;
  Latency target_latency_;
};

}  // namespace armtrue::canopen

#endif  // ARMTRUE_FIRMWARE_CANOPEN_MOTION_JOINT_PATH_H_
