// From target frames to corrected targets, and from actual positions back.
//
// The target RPDOs together make one *set*: the targets of all joints for one cycle. A set is
// evaluated when its last frame is here, and only then; what is incomplete at the next SYNC, or
// when the set window has passed since its first frame, is dropped and counted. Nothing is ever
// repeated, completed from an older cycle or extrapolated: no complete set, no output. After the
// stale time-out without a set the stream counts as interrupted and EMCY 0xFF10 is raised; the next
// set that goes out ends that.
//
// Asynchronous target RPDOs (254, 255): a set goes out at once, but only after a whole one, since a
// frame that was late instead of lost could stand for its successor. A stream therefore begins with
// its second set. Synchronous ones (0 to 240): a set goes out ahead of the SYNC that ends its
// interval, when all that can contradict it has come; the drives take it at that SYNC.
//
// Where SYNC is in use there is one set for each interval: a second controller that commands the
// same joints is noticed (EMCY 0xFF14), and after a contradiction nothing goes out until the next
// SYNC.
//
//   inline   the frames of the set are held, their target bytes rewritten, and released
//            downstream in the order in which they came; all other bytes are untouched
//   offset   0x60B0 of every axis is set and the TPDOs that carry it are sent; the frames
//            themselves are none of our business
//
// After a start or a change of mode nobody here knows what the drives hold. Once all actual
// positions have been heard, the first set begins with the difference from its targets, as far as
// the table permits a correction, and blends from there. In offset mode the drives follow the
// controller by themselves, and an arm in motion differs by its following error as well: nothing
// goes out until it has stood for kRestUs where the difference is permitted. Where not all have
// been heard a correction begins at zero.
#ifndef ARMTRUE_FIRMWARE_CANOPEN_MOTION_JOINT_PATH_H_
#define ARMTRUE_FIRMWARE_CANOPEN_MOTION_JOINT_PATH_H_

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include "firmware/canopen/protocol/can_port.h"
#include "firmware/canopen/protocol/emcy.h"
#include "firmware/canopen/protocol/object_dictionary.h"
#include "firmware/canopen/protocol/pdo.h"
#include "firmware/core/compensator.h"

namespace armtrue::canopen {

// 0x2000 sub 1.
enum class Mode : std::uint8_t { kForward = 0, kInline = 1, kOffset = 2 };

// What the joint path counts; the compensator counts the rest.
struct JointCounters {
  std::uint32_t sets = 0;       // complete sets evaluated
  std::uint32_t stale = 0;      // times the stream was interrupted
  std::uint32_t withheld = 0;   // sets that did not go out: a frame missing, late or contradicted
  std::uint32_t repeated = 0;   // frames dropped because the set had them already
  std::uint32_t malformed = 0;  // PDOs shorter than their mapping
  std::uint32_t conflicts = 0;  // targets that contradict others of the same SYNC interval
  std::uint32_t output_refused = 0;  // frames that the downstream port did not take
  std::uint32_t worst_cycle_us = 0;
};

class JointPath {
 public:
  JointPath(ObjectDictionary& dictionary, Compensator& compensator, Emcy& emcy,
            std::uint8_t joint_count, std::uint64_t (*clock_us)());

  // Decides from the mappings which RPDOs make a set. Drops a set in the making.
  void configure(const PdoTable& pdos);

  // Whether every joint is mapped in the target RPDOs. Without that nothing is ever evaluated.
  bool is_configured() const { return expected_ != 0; }

  // Whether this RPDO is one of the set.
  bool carries_target(std::size_t rpdo) const { return (expected_ >> rpdo & 1U) != 0; }

  // Takes a target frame. `downstream` is where inline output goes, nullptr for offset mode.
  // Returns true if it completed a set and the outputs are fresh.
  bool take_target(const Pdo& pdo, std::size_t rpdo, const CanFrame& frame, CanPort* downstream,
                   std::uint64_t now_us);

  // SYNC divides sets. With synchronous target RPDOs a complete set is evaluated here, not before.
  // Returns true if outputs are fresh.
  bool on_sync(CanPort* downstream, std::uint64_t now_us);

  // Rewrites the actual positions in a frame from the drives, by the correction that was in force;
  // before the first set there is none.
  void take_feedback(const Pdo& pdo, CanFrame& frame);

  // Windows and time-outs. Returns whether the supervision is sound, which is what feeds the
  // watchdog: the last call was at most kSupervisionUs ago, and no stream went on without a set for
  // that much longer than the stale time-out.
  bool process(std::uint64_t now_us);
  static constexpr std::uint64_t kSupervisionUs = 100'000;

  // Output stops, the set in the making is dropped: NMT left operational, a reset, a mode change.
  void stop();

  // What the drives hold is not known any more: the next stream begins with what is heard.
  void forget();

  // Offset mode: the drives' offsets are to become zero because nothing will follow. True while
  // they are on their way; then what the drives hold counts as forgotten. Call until it is false.
  bool leave();
  bool is_leaving() const { return leaving_; }

  // Offset mode: takes the next step towards zero where no stream of targets does. True if outputs
  // are fresh.
  bool fade(std::uint64_t now_us);

  // Whether the correction began with what the drives were heard to hold.
  bool knows_drives() const { return known_; }

  // A target frame is on the bus, whatever becomes of it: tables are not changed now.
  void note_command(std::uint64_t now_us) {
    seen_target_ = true;
    last_target_us_ = now_us;
  }

  // Microseconds since the last target frame; a large number before the first.
  std::uint64_t quiet_us(std::uint64_t now_us) const;

  // The bus refused so many frames with offsets.
  void note_refused(std::uint32_t frames);

  // A temperature or the payload has been given by SDO or PDO.
  void note_temperature(std::size_t sensor, std::uint64_t now_us);

  bool is_streaming() const { return streaming_; }
  std::uint16_t last_flags() const { return last_flags_; }
  const JointCounters& counters() const { return counters_; }

 private:
  static constexpr std::size_t kSetMax = kAxes;  // frames: at worst one for each axis

  struct Held {
    CanFrame frame;  // as received
    const Pdo* pdo = nullptr;
    std::uint8_t rpdo = 0;
  };
  static const Held* find(std::span<const Held> frames, std::size_t rpdo);

  void drop_set();
  void end_interval();
  void close_window(std::uint64_t now_us);
  bool evaluate(CanPort* downstream, std::uint64_t now_us);
  bool begin(bool drives_wait, std::uint64_t now_us);
  void put_out(std::uint64_t now_us);
  void read_inputs(std::uint64_t now_us);
  void release(CanPort& downstream);
  void interrupted();

  // Sets without a contradiction or a short frame after which the condition is over.
  static constexpr std::uint32_t kCleanSets = 100;
  // Following errors are over when the targets have stood for so long.
  static constexpr std::uint32_t kRestUs = 100'000;

  ObjectDictionary& dictionary_;
  Compensator& compensator_;
  Emcy& emcy_;
  std::uint64_t (*clock_us_)();
  std::uint8_t joint_count_;

  std::array<Held, kSetMax> held_ = {};      // of this interval, in the order of arrival
  std::array<Held, kSetMax> previous_ = {};  // the last evaluated set
  std::uint8_t held_count_ = 0;
  std::uint8_t previous_count_ = 0;
  std::uint32_t expected_ = 0;  // bit r: RPDO r belongs to the set
  std::uint32_t present_ = 0;
  bool synchronous_ = false;
  std::uint64_t set_begin_us_ = 0;
  bool sync_in_use_ = false;  // SYNC has come within the stale time-out
  bool evaluated_ = false;    // this interval's set is out
  bool spoilt_ = false;       // contradicted or malformed: nothing more in this interval
  bool trusted_ = false;      // the interval before was whole
  std::uint64_t last_sync_us_ = 0;
  std::uint64_t sync_period_us_ = 0;  // between the last two SYNCs
  std::uint32_t clean_sets_ = 0;

  CycleInput input_;
  std::uint32_t last_cycle_ = 0;
  std::uint32_t first_cycle_ = 0;
  std::uint64_t last_output_us_ = 0;
  bool begun_ = false;       // a set has gone out since what the drives held was unknown
  bool known_ = false;       // and it began with what they were heard to hold
  bool leaving_ = false;     // offsets go to zero, nothing follows
  std::uint32_t heard_ = 0;  // bit k: the actual position of axis k came while nothing had begun
  std::array<std::int32_t, kMaxJoints> resting_ = {};  // targets, since resting_since_us_
  std::uint64_t resting_since_us_ = 0;
  std::uint16_t last_flags_ = 0;
  bool streaming_ = false;
  bool seen_target_ = false;
  std::uint64_t last_target_us_ = 0;
  std::uint64_t last_set_us_ = 0;
  std::uint64_t last_process_us_ = 0;
  std::array<std::uint64_t, kMaxSensors> temperature_us_ = {};
  std::uint32_t temperature_given_ = 0;  // bit s: sensor s has been given since start
  JointCounters counters_;
};

}  // namespace armtrue::canopen

#endif  // ARMTRUE_FIRMWARE_CANOPEN_MOTION_JOINT_PATH_H_
