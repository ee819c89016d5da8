#include "firmware/testing/drive_soak.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <numbers>
#include <stdexcept>
#include <utility>
#include <vector>

#include "firmware/testing/test_table.h"

namespace armtrue::canopen {
namespace {

constexpr std::int32_t kPermitted = 400;  // increments
constexpr double kTurn = 1 << 20;
constexpr std::size_t kTurning = 5;           // the axis that turns without end
constexpr double kRate = 0.1 * kTurn * 1e-6;  // increments a microsecond
constexpr double kCycleUs = 1000.0;
constexpr double kSaved = kCycleUs * kRate;  // at most one cycle's change is saved up
constexpr double kSlack = 3.0;               // rounding of both ends
constexpr std::uint64_t kSettles = 400;      // cycles: rest in offset mode, a blend, a fade
constexpr int kFault = 0x0218;
constexpr int kCyclic = 8;
constexpr int kHomingMode = 6;
constexpr int kTorque = 4;

std::int32_t within_turn(std::int64_t position) {
  const std::int64_t turn = static_cast<std::int64_t>(kTurn);
  return static_cast<std::int32_t>((position % turn + turn) % turn);
}
// The shortest way, on the axis that turns without end.
std::int32_t way(std::size_t axis, std::int64_t difference) {
  if (axis != kTurning) return static_cast<std::int32_t>(difference);
  const std::int64_t half = static_cast<std::int64_t>(kTurn) / 2;
  return within_turn(difference + half) - static_cast<std::int32_t>(half);
}
std::int32_t moved(std::size_t axis, std::int32_t position, std::int32_t by) {
  const std::int64_t sum = std::int64_t{position} + by;
  return axis == kTurning ? within_turn(sum) : static_cast<std::int32_t>(sum);
}

}  // namespace

const char* name_of(DriveEvent event) {
  constexpr const char* kNames[] = {"disabled axis", "fault",       "homing",         "hand-guided",
                                    "other mode",    "other table", "disable/enable", "power lost",
                                    "pause",         "lost target", "stopped node"};
  static_assert(std::size(kNames) == kDriveEvents);
  return kNames[static_cast<std::size_t>(event)];
}

DriveSoak::DriveSoak(std::uint32_t seed, Mode mode)
    : offset_(mode == Mode::kOffset), bench_(!offset_), random_(seed) {
  configure();
  come_back(false);
}

void DriveSoak::configure() {
  const auto write = [this](std::uint32_t index, std::uint8_t sub, std::uint32_t value, int size) {
    if (bench_.write(static_cast<std::uint16_t>(index), sub, value, size) != 0) {
      throw std::runtime_error("cannot configure");
    }
  };
  write(0x607B + 0x800 * kTurning, 1, 0, 4);
  write(0x607B + 0x800 * kTurning, 2, static_cast<std::uint32_t>(kTurn) - 1, 4);
  // RPDO 12 to 15, 17 and 18 receive statuswords and modes.
  constexpr std::uint32_t kHears[] = {11, 12, 13, 14, 16, 17};
  for (std::uint32_t k = 0; k < 6; ++k) {
    const std::uint32_t number = kHears[k];
    write(0x1600 + number, 0, 0, 1);
    write(0x1600 + number, 1, (0x6041U + 0x800U * k) << 16 | 0x10U, 4);
    write(0x1600 + number, 2, (0x6061U + 0x800U * k) << 16 | 0x08U, 4);
    write(0x1600 + number, 0, 2, 1);
    write(0x1400 + number, 1, 0x1D0U + k, 4);
  }
  bench_.install(TestTable{.magnitude = kPermitted << 12}.image());
  bench_.configure(offset_ ? Mode::kOffset : Mode::kInline);
  write(0x1010, 1, kSave, 4);
  for (std::size_t k = 0; k < 6; ++k) drive_says(k, kOperationEnabled, kCyclic);
  take_output();
}

void DriveSoak::require(bool holds, const std::string& what) {
  if (!holds && failure_.empty()) {
    failure_ = "cycle " + std::to_string(figures_.cycles) + ": " + what;
  }
}

double DriveSoak::expected(std::size_t axis) const {
  const double largest = amplitude_ / std::exp2(32) * kTurn / (2.0 * std::numbers::pi);
  return -largest * std::sin(2.0 * std::numbers::pi * meant_[axis] / kTurn);
}

std::string DriveSoak::run(std::uint64_t cycles) {
  const std::uint64_t end = figures_.cycles + cycles;
  while (figures_.cycles < end && failure_.empty()) {
    run_settled(20 + random_() % 400);
    const auto event = static_cast<DriveEvent>(random_() % kDriveEvents);
    ++figures_.events[static_cast<std::size_t>(event)];
    carry_out(event);
    if (!failure_.empty()) failure_ += std::string(" (") + name_of(event) + ")";
  }
  return failure_;
}

void DriveSoak::run_settled(std::uint64_t cycles) {
  for (std::uint64_t k = 0; k < cycles && failure_.empty(); ++k) {
    move();
    cycle(true);
  }
}

void DriveSoak::carry_out(DriveEvent event) {
  settled_ = 0;
  switch (event) {
    case DriveEvent::kDisabled:
      return away(kSwitchOnDisabled, kCyclic, Drive::kStands, true);
    case DriveEvent::kFault:
      return away(kFault, kCyclic, Drive::kStands, false);
    case DriveEvent::kHoming:
      return away(kOperationEnabled, kHomingMode, Drive::kMovesItself, random_() % 2 == 0);
    case DriveEvent::kHandGuided:
      return away(kOperationEnabled, kTorque, Drive::kMovesItself, true);
    case DriveEvent::kOtherMode:
      // As docs/protocol.md says: inline, disable while targets come; at rest nothing is sent.
      bench_.write(0x2000, 2, 0, 1);
      for (int k = 0; k < 200 && !offset_; ++k) cycle(true);
      idle(600);
      bench_.write(0x2000, 1, 0, 1);
      idle(600);
      bench_.write(0x2000, 1, offset_ ? 2 : 1, 1);
      bench_.write(0x2000, 2, 1, 1);
      forget_drives();
      break;
    case DriveEvent::kOtherTable: {
      idle(600);
      amplitude_ = (1 << 21) + static_cast<std::int32_t>(random_() % (1U << 21));
      if (random_() % 2 == 0) amplitude_ = -amplitude_;
      // Flash is erased only while the drives are disabled.
      for (std::size_t k = 0; k < 6; ++k) drive_says(k, kSwitchOnDisabled, kCyclic);
      bench_.install(
          TestTable{.sequence = ++sequence_, .amplitude = amplitude_, .magnitude = kPermitted << 12}
              .image());
      for (std::size_t k = 0; k < 6; ++k) drive_says(k, kOperationEnabled, kCyclic);
      take_output();
      break;
    }
    case DriveEvent::kDisableEnable:
      bench_.write(0x2000, 2, 0, 1);
      for (int k = 0; k < 200; ++k) {
        move();
        cycle(true);
      }
      for (const std::int32_t delta : delta_) require(delta == 0, "a correction that is disabled");
      idle(600);
      bench_.write(0x2000, 2, 1, 1);
      break;
    case DriveEvent::kPowerLost:
      bench_.power_on();
      forget_drives();
      bench_.start_nodes();
      for (std::size_t k = 0; k < 6; ++k) drive_says(k, kOperationEnabled, kCyclic);
      break;
    case DriveEvent::kPause:
      idle(5 + random_() % 300);
      break;
    case DriveEvent::kLostTarget:
      move();
      cycle(true, static_cast<std::uint32_t>(random_() % 3));
      break;
    default:
      bench_.from_controller(make_frame(0, {128, NodeBench::kNodeId}));
      idle(100);
      bench_.start_nodes();
  }
  come_back(false);
}

// One axis does not follow for a while. Its target is its actual position; the others stand still.
void DriveSoak::away(int statusword, int mode, Drive drive, bool stream) {
  const std::size_t axis = random_() % 6;
  drive_[axis] = drive;
  drive_says(axis, statusword, mode);
  const std::uint64_t lasts = 150 + random_() % 500;
  const auto by = static_cast<std::int32_t>(random_() % 9) - 4;
  for (std::uint64_t k = 0; k < lasts && failure_.empty(); ++k) {
    if (drive == Drive::kMovesItself) stand_[axis] = moved(axis, stand_[axis], by);
    target_[axis] = seen_[axis];
    cycle(stream);
  }
  const std::uint32_t phase = bench_.read(0x2005, 3);
  require(phase == static_cast<std::uint32_t>(Phase::kSuspended), "not suspended");
  for (std::size_t k = 0; k < 6; ++k) {
    // Inline, the other drives get no output without a stream and keep their corrections.
    if (!offset_ && !stream && k != axis) continue;
    require(bench_.read(static_cast<std::uint16_t>(0x60B0 + 0x800 * k), 0) == 0,
            "suspended with a correction on joint " + std::to_string(k + 1));
  }
  ++figures_.suspended;
  drive_[axis] = Drive::kFollows;
  drive_says(axis, kOperationEnabled, kCyclic);
  // The controller starts from the actual positions that it received.
  for (std::size_t k = 0; k < 6; ++k) target_[k] = seen_[k];
  come_back(true);
}

// The event is over: within kSettles cycles the correction is complete.
void DriveSoak::come_back(bool was_suspended) {
  for (std::uint64_t k = 0; k < kSettles && failure_.empty(); ++k) cycle(true);
  settled_ = 1;
  require(bench_.read(0x2005, 3) == static_cast<std::uint32_t>(Phase::kCorrecting),
          "the correction did not come back");
  for (std::size_t k = 0; k < 6; ++k) {
    require(std::abs(delta_[k] - expected(k)) < kSlack,
            "joint " + std::to_string(k + 1) + ": correction " + std::to_string(delta_[k]) +
                ", expected " + std::to_string(expected(k)));
  }
  if (was_suspended && failure_.empty()) ++figures_.came_back;
}

void DriveSoak::forget_drives() {
  known_ = 0;
  seen_known_ = 0;
  take_output();
  known_ = 0;
}

void DriveSoak::drive_says(std::size_t axis, int statusword, int mode) {
  const CanFrame frame = make_frame(static_cast<std::uint32_t>(0x1D0 + axis),
                                    {statusword & 0xFF, statusword >> 8, mode});
  offset_ ? bench_.from_controller(frame) : bench_.from_drives(frame);
  take_output();
}

void DriveSoak::move() {
  for (std::size_t k = 0; k < 6; ++k) {
    const std::int32_t by = k == kTurning ? 300 : static_cast<std::int32_t>(k) - 2;
    const std::int32_t before = target_[k];
    target_[k] = moved(k, target_[k], by);
    if (k == kTurning && target_[k] < before) ++figures_.wraps;
  }
}

void DriveSoak::idle(std::uint64_t milliseconds) {
  for (std::uint64_t k = 0; k < milliseconds && failure_.empty(); ++k) cycle(false);
}

// One cycle of 1 ms. `lost`: which of the three target frames is not sent (3: none).
void DriveSoak::cycle(bool targets, std::uint32_t lost) {
  ++figures_.cycles;
  bench_.now_us += 1000;
  bench_.turn();
  if (targets) bench_.from_controller(make_frame(0x80, {}));
  take_output();
  feed_back();
  if (offset_) take_output();  // sent meanwhile
  if (!targets) return;
  const auto frames = NodeBench::targets(target_);
  for (std::uint32_t k = 0; k < 3; ++k) {
    if (k != lost) bench_.from_controller(frames[k]);
  }
  // Drives in offset mode follow the controller's own frames.
  if (offset_ && lost > 2) meant_ = target_;
  take_output();
  for (std::size_t k = 0; k < 6; ++k) {
    if (offset_ && lost > 2 && drive_[k] == Drive::kFollows) {
      stand_[k] = moved(k, meant_[k], delta_[k]);
    }
  }
  if (settled_ == 0) return;
  for (std::size_t k = 0; k < 6; ++k) {
    require(
        std::abs(delta_[k] - expected(k)) < kSlack,
        "joint " + std::to_string(k + 1) + ": a wrong correction, " + std::to_string(delta_[k]));
  }
  ++figures_.right;
}

void DriveSoak::take_output() {
  std::vector<CanFrame> frames = std::exchange(bench_.aside, {});
  auto& port = offset_ ? bench_.upstream : bench_.downstream;
  for (const CanFrame& frame : port.take_sent()) frames.push_back(frame);
  const std::uint32_t base = offset_ ? 0x1A0 : 0x220;
  std::size_t pairs = 0;
  for (const CanFrame& frame : frames) {
    const std::uint32_t pair = frame.id < base ? 3 : (frame.id - base) / 0x100;
    if (pair > 2 || frame.id != base + 0x100 * pair || frame.len != 8) continue;
    ++pairs;
    for (std::size_t k = 0; k < 2; ++k) {
      const std::size_t axis = 2 * pair + k;
      const auto value = load_le<std::int32_t>(&frame.data[4 * k]);
      if (!offset_) meant_[axis] = target_[axis];
      judge_output(axis, offset_ ? value : way(axis, std::int64_t{value} - target_[axis]));
      if (drive_[axis] == Drive::kFollows) stand_[axis] = moved(axis, meant_[axis], delta_[axis]);
      if (axis == kTurning && !offset_) {
        require(value >= 0 && value < kTurn, "a target outside the range of its axis");
      }
    }
  }
  figures_.outputs += pairs / 3;
}

void DriveSoak::judge_output(std::size_t axis, std::int32_t delta) {
  const std::string who = "joint " + std::to_string(axis + 1) + ": ";
  require(std::abs(delta) <= kPermitted + 1, who + "more than the table permits");
  if ((known_ >> axis & 1U) != 0) {
    const auto elapsed = static_cast<double>(bench_.now_us - judged_us_[axis]);
    credit_[axis] = std::min(credit_[axis] + elapsed * kRate, kSaved);
    // A controller continues from the actual positions that it received. Inline, a drive's step is
    // therefore the correction added to its target minus the one taken off its actual position.
    const std::int32_t from = offset_ ? delta_[axis] : taken_off_[axis];
    const double change = std::abs(static_cast<double>(delta) - from);
    figures_.largest_output_step =
        std::max(figures_.largest_output_step, change / (kCycleUs * kRate));
    require(change <= credit_[axis] + kSlack,
            who + "a step of the correction from " + std::to_string(from) + " to " +
                std::to_string(delta) + " after " + std::to_string(elapsed) + " us");
    credit_[axis] -= change;
  } else {
    credit_[axis] = kSaved;
  }
  known_ |= 1U << axis;
  delta_[axis] = delta;
  judged_us_[axis] = bench_.now_us;
}

void DriveSoak::feed_back() {
  for (std::size_t pair = 0; pair < 3; ++pair) {
    const auto id = static_cast<std::uint32_t>(0x1C0 + pair);
    const CanFrame frame = NodeBench::pair_frame(id, stand_[2 * pair], stand_[2 * pair + 1]);
    Joints back = stand_;
    if (offset_) {
      bench_.from_controller(frame);
      for (std::size_t k = 2 * pair; k < 2 * pair + 2; ++k) {
        back[k] = bench_.node().dictionary().get(od::axis::kPositionActualValue[k]);
      }
    } else {
      bench_.from_drives(frame);
      for (const CanFrame& passed : bench_.upstream.take_sent()) {
        if (passed.id != id) continue;
        back[2 * pair] = load_le<std::int32_t>(&passed.data[0]);
        back[2 * pair + 1] = load_le<std::int32_t>(&passed.data[4]);
      }
    }
    for (std::size_t k = 2 * pair; k < 2 * pair + 2; ++k) {
      const std::int32_t off = way(k, std::int64_t{stand_[k]} - back[k]);
      const auto elapsed = static_cast<double>(bench_.now_us - fed_back_us_[k]);
      seen_credit_[k] = std::min(seen_credit_[k] + elapsed * kRate, kSaved);
      const double change = std::abs(static_cast<double>(off) - taken_off_[k]);
      // Before the first set after a start, actual positions are passed on unchanged: that is no
      // step of the correction.
      if ((seen_known_ >> k & 1U) != 0 && known_ == 0x3F) {
        figures_.largest_feedback_step =
            std::max(figures_.largest_feedback_step, change / (kCycleUs * kRate));
        require(change <= seen_credit_[k] + kSlack,
                "joint " + std::to_string(k + 1) + ": a step in its actual position, from " +
                    std::to_string(taken_off_[k]) + " to " + std::to_string(off));
        seen_credit_[k] -= change;
      }
      if (known_ == 0x3F) seen_known_ |= 1U << k;
      taken_off_[k] = off;
      seen_[k] = back[k];
      fed_back_us_[k] = bench_.now_us;
    }
  }
}

}  // namespace armtrue::canopen
