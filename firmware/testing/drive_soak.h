// Hours of motion with drives that do not always follow: states, homing, hand-guiding, lost power,
// another mode, other tables, an axis that turns without end. The judge knows the table and every
// drive's motion. It checks every target or offset that the node sends and every actual position
// that it returns to the controller.
#ifndef ARMTRUE_FIRMWARE_TESTING_DRIVE_SOAK_H_
#define ARMTRUE_FIRMWARE_TESTING_DRIVE_SOAK_H_

#include <array>
#include <cstdint>
#include <random>
#include <string>

#include "firmware/testing/node_bench.h"

namespace armtrue::canopen {

enum class DriveEvent : std::uint8_t {
  kDisabled,    // an axis leaves operation enabled; targets go on
  kFault,       // an axis faults and the controller stops sending
  kHoming,      // an axis moves by itself
  kHandGuided,  // an axis is moved by hand in torque mode; the controller follows its position
  kOtherMode,   // the compensator goes to forward mode and back
  kOtherTable,  // an operator installs another table
  kDisableEnable,
  kPowerLost,    // the compensator browns out and restarts
  kPause,        // targets stop for a while
  kLostTarget,   // one target frame is lost
  kStoppedNode,  // NMT pre-operational and start
  kCount,
};
inline constexpr std::size_t kDriveEvents = static_cast<std::size_t>(DriveEvent::kCount);
const char* name_of(DriveEvent event);

struct DriveSoakFigures {
  std::uint64_t cycles = 0;
  std::uint64_t outputs = 0;           // sets of targets or offsets, judged for each axis
  std::uint64_t right = 0;             // sets with the full correction of the table
  std::uint64_t suspended = 0;         // events in which the correction went to zero
  std::uint64_t came_back = 0;         // of these, events after which it was complete again
  std::uint64_t wraps = 0;             // of the axis that turns without end
  double largest_output_step = 0.0;    // of a correction, relative to the permitted one
  double largest_feedback_step = 0.0;  // of what is taken off actual positions, likewise
  std::array<std::uint64_t, kDriveEvents> events = {};
};

class DriveSoak {
 public:
  DriveSoak(std::uint32_t seed, Mode mode);

  // Runs at least `cycles` milliseconds. Returns the first fault found, empty for none.
  std::string run(std::uint64_t cycles);
  const DriveSoakFigures& figures() const { return figures_; }

  // For the test that the judge detects a fault.
  void disable_correction() { bench_.write(0x2000, 2, 0, 1); }
  void run_settled(std::uint64_t cycles);
  const std::string& failure() const { return failure_; }

 private:
  using Joints = std::array<std::int32_t, 6>;
  enum class Drive : std::uint8_t { kFollows, kStands, kMovesItself };

  void configure();
  void carry_out(DriveEvent event);
  void away(int statusword, int mode, Drive drive, bool stream);
  void drive_says(std::size_t axis, int statusword, int mode);
  void cycle(bool targets, std::uint32_t lost = 3);
  void idle(std::uint64_t milliseconds);
  void move();
  void take_output();
  void feed_back();
  void judge_output(std::size_t axis, std::int32_t delta);
  void come_back(bool was_suspended);
  void forget_drives();
  double expected(std::size_t axis) const;
  void require(bool holds, const std::string& what);

  bool offset_;
  NodeBench bench_;
  std::mt19937 random_;
  DriveSoakFigures figures_;
  std::string failure_;
  std::int32_t amplitude_ = 1 << 22;
  std::uint32_t sequence_ = 1;
  Joints target_ = {230'000, 300'000, 150'000, -250'000, 270'000, 200'000};
  Joints stand_ = target_;  // where the drives are
  Joints meant_ = target_;  // the targets of the last output
  Joints delta_ = {};       // the corrections of the last output
  Joints taken_off_ = {};   // last taken off the actual positions
  Joints seen_ = target_;
  std::array<Drive, 6> drive_ = {};
  std::uint32_t known_ = 0;       // bit k: delta_[k] was sent since the node's last start
  std::uint32_t seen_known_ = 0;  // bit k: likewise taken_off_[k]
  std::array<double, 6> credit_ = {};
  std::array<double, 6> seen_credit_ = {};
  std::array<std::uint64_t, 6> judged_us_ = {};
  std::array<std::uint64_t, 6> fed_back_us_ = {};
  std::uint64_t settled_ = 0;  // 0 from an event until the correction is complete, then 1
};

}  // namespace armtrue::canopen

#endif  // ARMTRUE_FIRMWARE_TESTING_DRIVE_SOAK_H_
