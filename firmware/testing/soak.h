// Hours of 1 kHz motion with random bus faults, in process, as fast as it runs. The judge knows the
// table, every frame that was sent and what the drives hold. It checks every frame that the node
// sends, also through restarts and stops. Used by soak_test.cc (a minute) and canopen_soak
// (./dev test: an hour).
#ifndef ARMTRUE_FIRMWARE_TESTING_SOAK_H_
#define ARMTRUE_FIRMWARE_TESTING_SOAK_H_

#include <array>
#include <cstdint>
#include <deque>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "firmware/testing/node_bench.h"

namespace armtrue::canopen {

// Faults that can happen in a cycle. Each is drawn independently, so several can coincide.
enum class Fault : std::uint8_t {
  kLostTarget,        // one target frame never arrives
  kRepeatedTarget,    // one arrives twice, at once or a little later
  kReorderedTargets,  // they arrive in another order
  kLateTarget,        // one arrives after the next SYNC
  kCorruptedTarget,   // the check sequence is wrong: no controller takes it, its sender repeats it
                      // later
  kShortTarget,       // wrong length code: fewer bytes than mapped
  kOversizeTarget,    // an FD frame of up to 64 bytes, of which eight are mapped
  kForeignTarget,     // same identifier as a target, but extended or remote
  kLostSync,
  kJitteredSync,  // SYNC comes anywhere in the cycle
  kSecondMaster,  // another controller sends its own targets
  kStrayNmt,      // another master stops, starts or resets nodes
  kStraySdo,      // SDO requests of every kind to the node, valid or not, aborted at any step
  kFullBus,      // for some milliseconds other traffic fills the bus upstream and nearly all of the
                 // downstream queue
  kUpstreamOff,  // bus-off for some milliseconds
  kDownstreamOff,
  kLostFrames,  // the controller reports overruns
  kPowerCycle,  // the node restarts in mid-motion
  kSilence,     // the controller stops for a while
  kCount,
};
inline constexpr std::size_t kFaults = static_cast<std::size_t>(Fault::kCount);
const char* name_of(Fault fault);

struct SoakFigures {
  std::uint64_t cycles = 0;
  std::uint64_t outputs = 0;           // cycles whose set was sent completely
  std::uint64_t partial = 0;           // sets cut short because the bus accepted no more
  std::uint64_t feedback_checked = 0;  // actual positions returned exactly as commanded
  std::uint64_t forwarded = 0;         // other frames passed on bit-identical
  std::uint64_t emergencies = 0;
  std::array<std::uint64_t, kFaults> faults = {};
  std::uint64_t longest_gap = 0;  // cycles without output after all faults had ended
};

class Soak {
 public:
  // `rate`: faults of each kind in a thousand cycles. `synchronous`: targets leave with SYNC.
  // `mode`: inline or offset.
  Soak(std::uint32_t seed, double rate, bool synchronous = false, Mode mode = Mode::kInline);

  // Turns the correction off by SDO, for the test that the judge detects it.
  void disable_correction() { bench_.write(0x2000, 2, 0, 1); }

  // Runs `cycles` milliseconds. Returns the first fault found and its cycle, empty for none.
  std::string run(std::uint64_t cycles);

  const SoakFigures& figures() const { return figures_; }

 private:
  using Joints = std::array<std::int32_t, 6>;

  void configure();
  void heal();
  bool draw(Fault fault);
  Joints targets_of(std::uint64_t pose) const;
  void stand_still(std::uint64_t cycles);
  void deliver(const CanFrame& frame);
  void step_to(std::uint64_t offset_us);
  void one_cycle();
  void disturb();
  void stray_sdo();
  void judge_downstream();
  void judge_set(std::vector<CanFrame>& set);
  void judge_offsets();
  void judge_joint(std::size_t joint, std::int32_t delta, std::int32_t commanded);
  void judge_gap(bool any_output);
  void begin_life();
  void judge_feedback();
  void judge_offset_feedback();
  void fail(const std::string& what);
  Joints unpack(const CanFrame& frame) const;

  // The target frame last sent with `id` for `pose`: the output changes nothing but its targets.
  const CanFrame& sent(std::uint64_t pose, std::uint32_t id) const {
    return sent_[pose % sent_.size()][id / 0x100 - 2];
  }

  Mode mode_;
  NodeBench bench_;
  std::mt19937 random_;
  double probability_;
  bool synchronous_;
  SoakFigures figures_;
  std::string failure_;
  std::deque<std::pair<std::uint64_t, Fault>> lately_;

  std::uint64_t cycle_ = 0;
  // The controller's path: one pose further in every cycle in which it does not stand still.
  std::uint64_t pose_ = 1;
  std::uint64_t previous_pose_ = 1;
  std::uint64_t lagging_pose_ = 1;  // where drives that follow the controller are
  std::uint64_t standing_until_ = 0;
  std::uint64_t begin_us_ = 0;
  std::array<std::array<CanFrame, 3>, 4> sent_ = {};
  std::vector<CanFrame> late_;              // to be delivered in the next cycle
  std::vector<CanFrame> expected_forward_;  // in order
  std::uint64_t last_output_cycle_ = 0;
  std::uint64_t last_output_pose_ = 0;
  bool has_output_ = false;
  std::uint64_t life_ = 0;            // bench_.lives at the last output
  std::uint32_t blended_ = 0;         // evaluations since the node started
  std::uint32_t blends_from_ = 0;     // the evaluation at which the output began
  std::uint64_t evaluated_life_ = 0;  // last life with an evaluation; its first pose
  std::uint64_t first_pose_ = 0;
  std::uint64_t interruptions_ = 0;         // before the controller last stood for lack of output
  std::array<std::uint32_t, 6> seen_ = {};  // blended_ at each joint's last output
  std::uint32_t rate_clamped_ = 0;
  bool was_at_rate_limit_ = false;
  bool whole_ = false;  // the last set was sent completely
  bool awaits_boot_ = false;
  std::uint32_t refused_ = 0;
  std::uint32_t refused_by_any_ = 0;  // frames refused by either bus
  std::uint64_t caught_up_at_ = 0;    // cycle
  std::uint32_t evaluated_ = 0;
  Joints last_delta_ = {};  // corrections that the drives hold, since these cycles
  std::array<std::uint64_t, 6> held_since_ = {};
  std::array<double, 6> last_expected_ = {};
  Joints last_commanded_ = {};
  Joints last_released_ = {};
  std::uint64_t disturbed_until_ = 0;  // a fault is still acting
  std::uint64_t silent_until_ = 0;
  std::uint64_t full_until_ = 0;
  std::uint64_t needs_healing_at_ = 0;
};

}  // namespace armtrue::canopen

#endif  // ARMTRUE_FIRMWARE_TESTING_SOAK_H_
