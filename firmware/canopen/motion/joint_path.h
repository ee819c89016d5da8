// Corrects the targets of received frames and removes the correction from actual positions.
//
// SetAssembler decides which frames form a set. A set is corrected when its last frame arrives.
// Asynchronous targets (transmission type 254, 255) leave at once. Synchronous ones (0 to 240) are
// corrected and held until SYNC; if they are contradicted before it, the correction is taken back.
// After the stale time-out without a set the stream counts as interrupted and EMCY 0xFF10 is
// raised. If targets come for 0.1 s and no set goes out, EMCY 0xFF15 is raised.
//
// A correction changes from the value that has reached its drive. If the bus refused an output, or
// it still waits for SYNC when the next one is computed, it is taken back for its joints.
//
//   inline   the frames of the set are held, their target bytes rewritten, and released
//            downstream in the order of arrival; all other bytes are unchanged
//   offset   0x60B0 of every axis is set and the TPDOs that carry it are sent; the target frames
//            are not changed
//
// Phase follows what the drives hold. After a start or a change of mode this is unknown. Once all
// actual positions have been received, the first correction is actual position minus target, cut to
// what the table permits, and blends from there; inline, nothing goes out while one of them is
// older than 0.1 s. In offset mode the drives follow the controller without this node, and in
// motion the difference contains the following error: nothing goes out until the targets have stood
// for 0.1 s, every actual position has been received after that, and the difference is permitted.
// If an actual position has never been received, the correction begins at zero.
#ifndef ARMTRUE_FIRMWARE_CANOPEN_MOTION_JOINT_PATH_H_
#define ARMTRUE_FIRMWARE_CANOPEN_MOTION_JOINT_PATH_H_

#include <array>
#include <cstddef>
#include <cstdint>

#include "firmware/canopen/motion/drive_states.h"
#include "firmware/canopen/motion/inline_output.h"
#include "firmware/canopen/motion/latency.h"
#include "firmware/canopen/motion/sensor_inputs.h"
#include "firmware/canopen/motion/sets/set_assembler.h"
#include "firmware/canopen/motion/start_positions.h"
#include "firmware/canopen/motion/stream_watch.h"
#include "firmware/canopen/protocol/can_port.h"
#include "firmware/canopen/protocol/command_backlog.h"
#include "firmware/canopen/protocol/emcy.h"
#include "firmware/canopen/protocol/object_dictionary.h"
#include "firmware/canopen/protocol/pdo.h"
#include "firmware/core/compensator.h"
#include "firmware/core/fixed/counter.h"

namespace armtrue::canopen {

// 0x2000 sub 1.
enum class Mode : std::uint8_t { kForward = 0, kInline = 1, kOffset = 2 };

// Which correction the drives hold.
enum class Phase : std::uint8_t {
  kUnknown,     // an unknown one: nothing has been sent since the start or the change of mode
  kCorrecting,  // the wanted correction, or blending to it
  kSuspended,   // zero, or fading to it, while suspension() gives a reason
  kLeaving,     // fading to zero because the output ends
};

// Why a correction is suspended, 0x2005 sub 4. Bits.
enum Suspension : std::uint8_t {
  kSuspendedNot = 0,
  kSuspendedAxisAway = 1U << 0,
  kSuspendedReference = 1U << 1,  // an encoder's zero was changed; until 0x2000 sub 2 is written
};

// Information of EMCY 0xFF15: why sets do not go out.
enum WhyWithheld : std::uint32_t {
  kFramesMissing = 1,   // no set of targets was complete within the set window
  kContradictions = 2,  // contradicted or short frames
  // Offset mode: the targets have not stood yet at a permitted difference, or not every actual
  // position has been received since. Inline: an actual position has not come for 0.1 s.
  kPositionUnknown = 3,
  kSyncMissing = 4,  // targets or offsets wait for SYNC, and none comes
  kNoSet = 5,        // the mapped targets form no set: too few joints, or an axis mapped twice
  kNotOperational = 6,
  kOutputRefused = 7,  // the bus did not take the set, or its offsets
};

// When offsets are sent, by the transmission types of the TPDOs that map them.
enum class OffsetOutput : std::uint8_t { kAtOnce, kWithSync };

// What the joint path counts; the compensator counts the rest.
struct JointCounters {
  std::uint32_t sets = 0;       // complete sets that went out
  std::uint32_t steps = 0;      // of the correction: with those sets, and of a fade without sets
  std::uint32_t stale = 0;      // times the stream was interrupted
  std::uint32_t withheld = 0;   // sets that did not go out: a frame missing, late or contradicted
  std::uint32_t repeated = 0;   // frames dropped because the set had them already
  std::uint32_t malformed = 0;  // PDOs shorter than their mapping
  std::uint32_t conflicts = 0;  // targets that contradict others of the same SYNC interval
  // Frames with targets or offsets that the drives' bus refused, and sets that were not computed
  // because the commands of too many cycles waited there.
  std::uint32_t output_refused = 0;
  std::uint32_t worst_cycle_us = 0;
  std::uint32_t suspended = 0;
  std::uint32_t resumed = 0;
  std::uint32_t reference_changes = 0;
};

class JointPath {
 public:
  // `upstream`: port on which the node sends offsets. `downstream`: port for inline output; nullptr
  // with one bus, where inline mode is refused.
  JointPath(ObjectDictionary& dictionary, Compensator& compensator, Emcy& emcy,
            const CanPort& upstream, CanPort* downstream, std::uint8_t joint_count,
            std::uint64_t (*clock_us)());

  // Decides from the mappings which RPDOs form a set. Drops a set that has not gone out.
  void configure(const PdoTable& pdos);
  // Takes ranges and limits of positions from the dictionary.
  void configure_bounds();

  // Changes the mode; the phase becomes kUnknown.
  void set_mode(Mode mode);
  Mode mode() const { return mode_; }

  // Whether the target RPDOs map every joint with a drive. In offset mode the TPDOs must also map
  // its offset, and the drives must be upstream. Otherwise no set is evaluated.
  bool is_configured() const;
  // Bit k is set if axis k has a drive. Before the first table all axes count as having one.
  std::uint32_t axes_with_drives() const;
  // Bit k: axis k has a drive, and it does not follow its targets. States of other axes are stale,
  // or nobody's.
  std::uint8_t axes_away() const {
    return static_cast<std::uint8_t>(drives_.away() & axes_with_drives());
  }
  // Whether this RPDO belongs to the set.
  bool carries_target(std::size_t rpdo) const {
    return is_configured() && sets_.carries_target(rpdo);
  }

  // Takes a target frame. Returns true if it put out a corrected set.
  bool take_target(const Pdo& pdo, std::size_t rpdo, const CanFrame& frame, std::uint64_t now_us);

  // Inline: passes on a target frame that commands a drive to stop, if that drive does not have the
  // command yet or sets do not go out. Call after take_target(), which may have sent it. `pdo`:
  // also one of a set that has lost its mapping.
  void forward_stop(const Pdo& pdo, const CanFrame& frame);
  // A frame was passed on to the drives unchanged.
  void note_forwarded(const Pdo& pdo, const CanFrame& frame) {
    inline_output_.note_forwarded(pdo, frame);
  }

  // Puts out the set that waits for SYNC and ends the interval. Returns true if it put out a set.
  bool on_sync(std::uint64_t now_us);

  // Takes statuswords, modes of operation and read-back offsets from a frame of the drives.
  void hear(const Pdo& pdo, const CanFrame& frame);

  // Subtracts from the actual positions in `frame` the correction that was in force; before the
  // first set there is none. Precondition: frame.len >= pdo.mapping.length.
  void take_feedback(const Pdo& pdo, CanFrame& frame, std::uint64_t now_us);

  // An actual position came from downstream: until the restart the drives count as downstream,
  // unless offset mode already knows them upstream.
  void note_drives_downstream() {
    if (mode_ != Mode::kOffset || !knows_drives()) drives_are_downstream_ = true;
  }
  // Whether the drives are on the downstream port. They would not receive offsets, which are sent
  // upstream.
  bool drives_are_downstream() const { return drives_are_downstream_; }

  // A PDO without targets was shorter than its mapping.
  void note_malformed() { count(counters_.malformed); }

  // Checks windows and time-outs. Returns whether the watchdog may be fed: the last call was at
  // most kSupervisionUs ago, and no stream has gone on without a set for more than the stale
  // time-out plus kSupervisionUs.
  bool process(std::uint64_t now_us);
  static constexpr std::uint64_t kSupervisionUs = 100'000;

  // Stops the output and drops the current set: change of NMT state, reset, change of mode.
  void stop();

  // Fades the drives' offsets to zero because the output ends. Returns true while they fade, for
  // kLeaveUs or kLeaveCycles at most; then the phase becomes kUnknown. Call until it returns false.
  bool leave(std::uint64_t now_us);
  bool is_leaving() const { return phase_ == Phase::kLeaving; }
  static constexpr std::uint64_t kLeaveUs = 5'000'000;
  // The same in control periods, for long ones: a fade takes up to kFadeCycles of them, and more
  // if the bus refuses some.
  static constexpr std::uint64_t kLeaveCycles = 5'000;
  static_assert(kLeaveCycles > 2 * Compensator::kFadeCycles);

  // Computes the next step towards zero when no stream of targets does. Returns true if it did.
  bool fade(std::uint64_t now_us);

  // 0x2000 sub 2 was written: whoever wrote it takes responsibility for a changed encoder zero.
  void accept_reference();

  // Whether the correction began with what the drives hold, by their actual positions.
  bool knows_drives() const { return phase_ != Phase::kUnknown && began_with_heard_; }
  Phase phase() const { return phase_; }
  const DriveStates& drives() const { return drives_; }
  std::uint8_t suspension() const;

  // Notes a target frame on the bus, whether or not it is used: table commands are refused for the
  // quiet time, and in inline mode the arm waits for the set.
  void note_command(std::uint64_t now_us) { stream_.note_command(now_us, stale_us()); }
  // Microseconds since the last target frame; a large number before the first.
  std::uint64_t quiet_us(std::uint64_t now_us) const { return stream_.quiet_us(now_us); }

  // Result of sending offsets, after a step or with SYNC. `refused`: number of frames that the bus
  // refused. `unsent`: bit k, the newest offset of axis k has not left.
  void note_offsets(std::uint32_t refused, std::uint32_t unsent, std::uint64_t now_us);

  // A port discarded outputs that it had accepted. Their drives hold the output before.
  void note_discarded(const Discarded& discarded);
  // The cycle whose output went out last.
  std::uint32_t last_cycle() const { return last_cycle_; }

  // Writes every value of a PDO into the dictionary, also values mapped beside targets.
  // Precondition: frame.len >= pdo.mapping.length.
  void take_input(const Pdo& pdo, const CanFrame& frame, std::uint64_t now_us) {
    inputs_.take(pdo, frame, now_us);
  }

  // An object has been written by SDO: a temperature or the payload counts as given.
  void note_input(std::uint16_t index, std::uint8_t sub, std::uint64_t now_us) {
    inputs_.note(index, sub, now_us);
  }

  bool is_streaming() const { return stream_.is_streaming(); }
  std::uint16_t last_flags() const { return last_flags_; }
  const JointCounters& counters() const { return counters_; }
  std::uint32_t window_us() const { return sets_.window_us(configured_window_us()); }
  // Time from a set's last received to its last corrected frame; asynchronous targets only, µs.
  const Latency& target_latency() const { return target_latency_; }

 private:
  std::uint32_t configured_window_us() const {
    return dictionary_.get(od::compensator_control::kSetWindow);
  }
  std::uint32_t stale_us() const { return dictionary_.get(od::compensator_control::kStaleTimeOut); }
  // Whether joint `axis` of the arm exists and has a drive.
  bool has_drive(std::size_t axis) const;
  void end_interval();
  void take_back();
  void take_back_unsent();
  void spoil(Condition condition, std::uint32_t information, std::uint32_t& counter);
  bool compute(std::uint64_t now_us);
  bool tells_positions(std::uint64_t now_us) const;
  bool begin(std::uint64_t now_us);
  bool release(std::uint64_t now_us);
  void note_set_out(std::uint64_t now_us);
  bool may_compute();
  bool is_kept_from_sync() const;
  void publish();
  void follow_drives();
  void read_targets(std::uint64_t now_us);
  void read_surroundings(std::uint64_t now_us);
  void check_offset(std::size_t axis, std::int32_t offset);
  void interrupted();
  void forget();
  void watch_stream(std::uint64_t now_us);
  std::uint32_t why_withheld(std::uint64_t now_us) const;

  // Consecutive sets without contradiction or short frame that end the EMCY conditions.
  static constexpr std::uint32_t kCleanSets = 100;
  // Consecutive read-back offsets, none of them sent lately, that raise EMCY 0xFF17.
  static constexpr std::uint32_t kStrangeOffsets = 20;

  ObjectDictionary& dictionary_;
  Compensator& compensator_;
  Emcy& emcy_;
  const CanPort& upstream_;
  CanPort* downstream_;
  std::uint64_t (*clock_us_)();
  std::uint8_t joint_count_;

  SetAssembler sets_;
  InlineOutput inline_output_;
  StreamWatch stream_;
  StartPositions start_;
  DriveStates drives_;
  SensorInputs inputs_;
  OffsetOutput offset_output_ = OffsetOutput::kAtOnce;
  std::uint32_t offset_axes_ = 0;  // bit k: the offset of axis k is mapped
  Mode mode_ = Mode::kForward;
  Phase phase_ = Phase::kUnknown;
  // Whether the first correction starts from what the drives reported (else from zero); set by
  // begin().
  bool began_with_heard_ = false;
  std::uint8_t changed_reference_ = 0;  // number of the axis whose zero was changed, 0 for none
  bool drives_are_downstream_ = false;
  std::uint32_t clean_sets_ = 0;

  CycleInput input_;    // of the cycle that is computed next
  CycleOutput output_;  // of the cycle that was computed last
  std::uint32_t last_cycle_ = 0;
  std::uint32_t first_cycle_ = 0;
  std::uint64_t computed_us_ = 0;   // when output_ was computed
  std::uint64_t last_step_us_ = 0;  // when the last output that went out was computed
  std::uint64_t leaving_since_us_ = 0;
  std::array<std::uint32_t, kMaxJoints> strange_offsets_ = {};
  std::uint16_t last_flags_ = 0;
  bool sets_pass_ = false;   // the last interval with frames put out its set
  bool is_refused_ = false;  // the drives' bus refused the last set or a part of it
  CommandBacklog backlog_;
  bool is_offset_set_ = false;  // the last set is in the offsets; note_offsets() is to follow
  std::uint8_t unsent_ = 0;     // bit k: the last output of joint k has not reached its drive
  std::uint64_t last_process_us_ = 0;
  JointCounters counters_;
  Latency target_latency_;
};

}  // namespace armtrue::canopen

#endif  // ARMTRUE_FIRMWARE_CANOPEN_MOTION_JOINT_PATH_H_
