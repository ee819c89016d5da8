// libFuzzer on a compensator between a controller and drives. The input is a list of steps: tables
// are installed, PDOs mapped, NMT commands sent, the arm moves. Two bytes per step: kind, variant.
//
// Properties that hold after any steps, with the names that a failure prints:
//   clamp         no correction exceeds 0.05 turn of the drives, in their own increments
//   rate          no correction changes faster than 0.1 turn a second, in time and not in sets
//   pass-through  while disabled, the output equals the input after at most kFadeCycles
//   comes back    a correction that is neither disabled nor suspended is active or blending in
//   way to zero   a disabled or suspended one fades to zero in offset mode even without targets
//   feedback      the correction of its own cycle is taken off an actual position
//   SYNC          nothing is evaluated between SYNC's arrival and its forwarding
//   NMT           commands that end the output take effect within seconds
//   cost          no accepted table takes many times the time of an ordinary one
//
// ARMTRUE_FUZZ_STEPS and ARMTRUE_FUZZ_TABLES, bit masks, select the steps and tables to run, to
// search beyond a fault that was found.
#include <array>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <span>
#include <string_view>
#include <utility>
#include <vector>

#include "firmware/core/table/test_image.h"
#include "firmware/testing/node_bench.h"
#include "firmware/testing/test_table.h"

namespace {

using namespace armtrue;
using namespace armtrue::canopen;
using Joints = std::array<std::int32_t, 6>;

constexpr Joints kStand = {230'000, 300'000, 150'000, -250'000, 270'000, -200'000};
constexpr std::int32_t kMagnitude = 4000;            // increments, of the tables made here
constexpr std::int32_t kAmplitude = 1 << 24;         // 650 increments
constexpr double kLargest = 0.05 * 1048576.0 + 1.0;  // increments
constexpr double kRate = 0.1 * 1048576.0 * 1e-6;     // increments a microsecond
constexpr double kSaved = 2.0 * 1000.0 * kRate;      // what two cycles may leave unused
constexpr double kSlack = 14.0;                      // rounding, and a target's own motion
// Time until a disabled correction is zero: a blend of 20 ms and a fade at full rate. With a table
// of a low rate: kFadeCycles.
constexpr std::int64_t kFadesWithin = 60;  // ms
constexpr std::int64_t kFadesSlowlyWithin = 2200;

enum class Step : std::uint8_t {
  kMove,
  kRest,
  kBackToBack,
  kQuiet,
  kDisable,
  kEnable,
  kInstall,
  kStageJunk,
  kNmt,
  kDrive,
  kSynchronous,
  kRevert,
  kPdo,
  kMode,
  kPowerCycle,
  kLate,
  kCount,
};

unsigned long mask_of(const char* variable) {
  const char* text = std::getenv(variable);
  return text == nullptr ? ~0UL : std::strtoul(text, nullptr, 0);
}

void require(bool holds, std::string_view what) {
  if (holds) return;
  std::fprintf(stderr, "does not hold: %.*s\n", static_cast<int>(what.size()), what.data());
  std::abort();
}

// Terms over many grids of four axes that share their data: a small table with much work.
std::vector<std::uint8_t> costly_table(std::uint32_t sequence) {
  constexpr std::uint16_t kGrids = 300;
  tests::TestImage made(6);
  tests::put(made.header(), format::header::kSequenceAt, sequence);
  for (std::uint8_t joint = 0; joint < 4; ++joint) {
    made.add_state(format::State::kMotor, joint, format::kPositionFraction);
  }
  tests::Bytes data = {4, 1, 0, 0};
  for (std::uint16_t axis = 0; axis < 4; ++axis) {
    tests::append(data, static_cast<std::uint16_t>(1 + axis));
    tests::append(data, std::uint16_t{2});  // nodes
    tests::append(data, std::uint32_t{0});
    tests::append(data, -(std::int32_t{1} << 29));
    tests::append(data, std::uint32_t{1} << 22);  // 2^52 / step, a step of 2^30
  }
  tests::append(data, std::uint32_t{0xFFFF});  // all nodes are covered
  for (int value = 0; value < 16; ++value) tests::append(data, std::int16_t{1});
  made.add(format::Section::kData, data);
  for (std::uint16_t grid = 0; grid < kGrids; ++grid) {
    tests::Bytes node = {static_cast<std::uint8_t>(format::Node::kGrid), 0, 0, 1};
    node.resize(format::node::kLength);
    made.add(format::Section::kNodes, node);
    made.add_term(0, static_cast<std::uint16_t>(5 + grid), 1e-6, 30);
  }
  return made.image();
}

class Life {
 public:
  Life(const storage::SimulatedFlash& flash, std::uint8_t setup)
      : offset_((setup & 1U) != 0),
        bench_(!offset_, false, {}, kMaxImageLength + storage::kHeaderBytes, &flash) {
    bench_.configure(offset_ ? Mode::kOffset : Mode::kInline);
    // RPDO 13 receives the statusword of axis 1.
    bench_.write(0x160C, 0, 0, 1);
    bench_.write(0x160C, 1, 0x60410010, 4);
    bench_.write(0x160C, 0, 1, 1);
    bench_.write(0x140C, 1, 0x1D0, 4);
    bench_.write(0x1010, 1, kSave, 4);
    take();
    feed_back();
  }

  // Returns false if nothing that follows can be judged.
  bool carry_out(Step step, std::uint8_t which) {
    switch (step) {
      case Step::kMove:
        return stream(length_of(which), 1000, 5);
      case Step::kRest:
        return stream(length_of(which), 1000, 0);
      case Step::kBackToBack:
        quiet(30);  // after this pause SYNC no longer counts as in use
        return stream(100, 70, 0, false);
      case Step::kQuiet:
        return quiet(600);
      case Step::kDisable:
        bench_.write(0x2000, 2, 0, 1);
        if (since_disabled_ < 0) since_disabled_ = 0;
        return noted();
      case Step::kEnable:
        quiet(600);
        if (bench_.write(0x2000, 2, 1, 1) == 0) since_disabled_ = -1;
        return noted();
      case Step::kInstall:
        return install(which);
      case Step::kStageJunk: {
        quiet(600);
        const std::vector<std::uint8_t> junk(400, static_cast<std::uint8_t>(which | 1U));
        bench_.stage(junk);
        return noted();
      }
      case Step::kNmt:
        return nmt(which);
      case Step::kDrive:
        return drive_says(which % 2 == 0 ? 0x0218 : kOperationEnabled);
      case Step::kLate:
        bench_.now_us += 500U * (1U + which % 8U);
        bench_.turn();
        return noted();
      case Step::kSynchronous:
        quiet(600);
        synchronous_ = which % 2 == 0;
        for (std::uint16_t k = 0; k < 3; ++k) {
          bench_.write(static_cast<std::uint16_t>(0x1400 + k), 2, synchronous_ ? 1 : 255, 1);
        }
        return noted();
      case Step::kRevert:
        quiet(600);
        bench_.command(TableCommand::kRevert);
        sequence_ += 2;
        return noted();
      case Step::kPdo: {
        quiet(600);
        // Switches one of the PDOs with targets or offsets off, or on again.
        const std::uint32_t pair = which % 3U;
        const auto record = static_cast<std::uint16_t>((offset_ ? 0x1800U : 0x1400U) + pair);
        bench_.write(record, 1, bench_.read(record, 1) ^ 0x80000000U, 4);
        return noted();
      }
      case Step::kMode:
        quiet(600);
        bench_.write(0x2000, 1, bench_.read(0x2000, 1) != 0 ? 0 : (offset_ ? 2 : 1), 1);
        quiet(fades_within_ > kFadesWithin ? 6000 : 600);
        // A start takes over what the drives hold, even a target's own motion, and fades it out.
        since_disabled_ = std::min<std::int64_t>(since_disabled_, 0);
        return noted();
      default:
        bench_.power_on();
        since_disabled_ = -1;
        is_away_ = false;
        synchronous_ = false;
        return begin_anew();
    }
  }

 private:
  static int length_of(std::uint8_t which) {
    constexpr int kLengths[] = {1, 5, 20, 40, 80, 160};
    return kLengths[which % std::size(kLengths)];
  }

  bool noted() {
    take();
    return true;
  }

  bool drive_says(int statusword) {
    const CanFrame frame = make_frame(0x1D0, {statusword & 0xFF, statusword >> 8});
    offset_ ? bench_.from_controller(frame) : bench_.from_drives(frame);
    is_away_ = statusword != kOperationEnabled;
    known_ &= ~1U;
    return noted();
  }

  // The compensator's state agrees with the requests, whatever happened to a set that waited.
  void judge_state(bool after_silence) {
    const CompensatorState state = bench_.compensator().state();
    const bool passes = state == CompensatorState::kPassThrough;
    const std::uint32_t phase = bench_.read(0x2005, 3);
    const bool is_enabled = bench_.read(0x2000, 2) != 0 && bench_.read(0x2013, 12) != 255;
    if (phase == 1 && is_enabled) require(!passes, "comes back");
    const bool is_at_once = offset_ && after_silence && fades_within_ == kFadesWithin;
    if (is_at_once && phase != 0 && (phase == 2 || !is_enabled)) require(passes, "way to zero");
    take();
  }

  // Time without targets: steps of 1 ms in the first 60 ms, in which fades run, then of 25 ms.
  bool quiet(int milliseconds) {
    for (int past = 0; past < milliseconds;) {
      const int step = past < 60 ? 1 : 25;
      past += step;
      bench_.now_us += 1000U * static_cast<unsigned>(step);
      bench_.turn();
      take();
      judge(target_);
    }
    judge_state(milliseconds >= 600);
    return true;
  }

  // What the drives hold is unknown: judging begins with the next output.
  bool begin_anew() {
    known_ = 0;
    bench_.start_nodes();
    take();
    feed_back();
    return true;
  }

  bool install(std::uint8_t which) {
    static const unsigned long tables = mask_of("ARMTRUE_FUZZ_TABLES");
    if ((tables >> (which % 8) & 1U) == 0) which = 0;
    quiet(600);
    TestTable table{.sequence = sequence_, .amplitude = kAmplitude, .magnitude = kMagnitude << 12};
    std::vector<std::uint8_t> image;
    switch (which % 8) {
      case 0:
      case 1:
        break;  // the table in force once more
      case 2:
        table.sequence = ++sequence_;
        table.rate = 500;
        fades_within_ = kFadesSlowlyWithin;
        break;
      case 3:
        table.sequence = ++sequence_;
        table.finer = 4;
        break;
      case 4:
        image = costly_table(++sequence_);
        break;
      case 5: {
        table.sequence = ++sequence_;
        image = table.image();
        const std::size_t joints = format::header::kLength + 4 * format::kDirectoryEntryLength;
        tests::put(image, joints + format::joint::kIncrementPerUnitAt, INT32_MAX);
        image[joints + format::joint::kIncrementShiftAt] = 31;
        tests::mend_checksum(image);
        break;
      }
      default:
        table.sequence = ++sequence_;
        table.amplitude = which % 2 == 0 ? kAmplitude : -kAmplitude;
    }
    if (image.empty()) image = table.image();
    bool taken = bench_.stage(image) == 0;
    for (const TableCommand word : {TableCommand::kVerify, TableCommand::kCommit,
                                    TableCommand::kActivate, TableCommand::kConfirm}) {
      taken = taken && bench_.command(word) == 0;
    }
    take();
    if (taken && which % 8 == 4) require(cost() < 20.0 * ordinary_cost(), "cost");
    return true;
  }

  // Seconds of processor time for one evaluation of the table in force.
  double cost() {
    double least = 1e9;
    for (int k = 0; k < 5; ++k) {
      bench_.now_us += 1000;
      const auto frames = NodeBench::targets(target_);
      timespec before;
      timespec after;
      clock_gettime(CLOCK_THREAD_CPUTIME_ID, &before);
      for (const CanFrame& frame : frames) bench_.from_controller(frame);
      clock_gettime(CLOCK_THREAD_CPUTIME_ID, &after);
      if (k > 1) {
        least = std::min(least, static_cast<double>(after.tv_sec - before.tv_sec) +
                                    1e-9 * static_cast<double>(after.tv_nsec - before.tv_nsec));
      }
      take();
    }
    known_ = 0;  // the outputs meanwhile were not judged
    return least;
  }
  static double ordinary_cost() {
    static const double measured = [] {
      NodeBench plain;
      plain.install(TestTable{}.image());
      plain.configure(Mode::kInline);
      double least = 1e9;
      for (int k = 0; k < 200; ++k) {
        plain.now_us += 1000;
        timespec before;
        timespec after;
        clock_gettime(CLOCK_THREAD_CPUTIME_ID, &before);
        plain.command_joints(kStand);
        clock_gettime(CLOCK_THREAD_CPUTIME_ID, &after);
        plain.downstream.take_sent();
        if (k > 100) {
          least = std::min(least, static_cast<double>(after.tv_sec - before.tv_sec) +
                                      1e-9 * static_cast<double>(after.tv_nsec - before.tv_nsec));
        }
      }
      return least;
    }();
    return measured;
  }

  bool nmt(std::uint8_t which) {
    constexpr int kCommands[] = {2, 128, 129, 130, 77};
    const int command = kCommands[which % std::size(kCommands)];
    const bool strange_behind = which % 2 == 0;
    const std::uint64_t lives = bench_.lives;
    bench_.from_controller(make_frame(0, {command, NodeBench::kNodeId}));
    take();
    const auto has_ended = [&] {
      return bench_.node().nmt_state() != NmtState::kOperational || bench_.lives != lives;
    };
    for (int k = 0; k < 6000 && command != 77 && !has_ended(); ++k) {
      bench_.now_us += 1000;
      bench_.turn();
      take();
      judge(target_);
      if (k == 1 && strange_behind) {
        bench_.from_controller(make_frame(0, {0x4D, NodeBench::kNodeId}));
      }
    }
    if (command == 77) return true;
    require(has_ended(), "NMT");
    if (command == 129) {
      since_disabled_ = -1;
      is_away_ = false;
    }
    if (command > 128) synchronous_ = false;
    bench_.run_for(2000);
    return begin_anew();
  }

  bool stream(int cycles, std::uint64_t period_us, std::int32_t way, bool with_sync = true) {
    for (int k = 0; k < cycles; ++k) {
      const Joints before = target_;
      bench_.now_us += period_us;
      // The first turn drops a set that is too old, the second takes the delayed step to zero.
      bench_.turn();
      bench_.turn();
      if (with_sync) {
        const std::uint32_t evaluated = bench_.compensator().counters().cycles;
        bench_.from_controller(make_frame(0x80, {}));
        // Fewer: an old set was taken back.
        require(bench_.compensator().counters().cycles <= evaluated, "SYNC");
      }
      take();
      judge(before);
      for (std::int32_t& joint : target_) joint += way;
      bench_.command_joints(target_);
      take();
      judge(target_);
      // The fade to zero begins with the first output after a start.
      if (since_disabled_ >= 0 && known_ != 0) {
        since_disabled_ += static_cast<std::int64_t>(period_us);
      }
      if (since_disabled_ > fades_within_ * 1000) {
        for (const std::int32_t delta : delta_) require(delta == 0 || known_ == 0, "pass-through");
      }
      feed_back();
    }
    if (cycles > 20) judge_state(false);
    return true;
  }

  // Takes the output for the drives.
  void take() {
    fresh_ = 0;
    std::vector<CanFrame> frames = std::exchange(bench_.aside, {});
    auto& port = offset_ ? bench_.upstream : bench_.downstream;
    for (const CanFrame& frame : port.take_sent()) frames.push_back(frame);
    const std::uint32_t base = offset_ ? 0x1A0 : 0x220;
    for (const CanFrame& frame : frames) {
      if (frame.len != 8 || frame.is(kFrameExtended) || frame.id < base) continue;
      const std::uint32_t pair = (frame.id - base) / 0x100;
      if (pair > 2 || frame.id != base + 0x100 * pair) continue;
      for (std::size_t k = 0; k < 2; ++k) {
        out_[2 * pair + k] = load_le<std::int32_t>(&frame.data[4 * k]);
        fresh_ |= 1U << (2 * pair + k);
      }
    }
  }

  void judge(const Joints& meant) {
    for (std::size_t k = 0; k < 6; ++k) {
      if ((fresh_ >> k & 1U) == 0) continue;
      const std::int32_t delta = offset_ ? out_[k] : out_[k] - meant[k];
      require(std::abs(delta) <= kLargest, "clamp");
      if ((known_ >> k & 1U) != 0) {
        const auto elapsed = static_cast<double>(bench_.now_us - judged_us_[k]);
        credit_[k] = std::min(credit_[k] + elapsed * kRate, kSaved);
        const double change = std::abs(static_cast<double>(delta) - delta_[k]);
        require(change <= credit_[k] + kSlack, "rate");
        credit_[k] -= change;
      } else {
        credit_[k] = kSaved / 2;
      }
      known_ |= 1U << k;
      delta_[k] = delta;
      judged_us_[k] = bench_.now_us;
    }
    fresh_ = 0;
    stand_meant_ = meant;
  }

  void feed_back() {
    if (is_away_) known_ &= ~1U;  // inline its fade to zero takes steps that no frame shows
    for (std::size_t pair = 0; pair < 3; ++pair) {
      Joints stand = target_;
      for (std::size_t k = 0; k < 6; ++k) stand[k] = stand_meant_[k] + delta_[k];
      const auto id = static_cast<std::uint32_t>(0x1C0 + pair);
      const CanFrame frame = NodeBench::pair_frame(id, stand[2 * pair], stand[2 * pair + 1]);
      if (offset_) {
        bench_.from_controller(frame);
        continue;
      }
      bench_.from_drives(frame);
      for (const CanFrame& back : bench_.upstream.take_sent()) {
        if (back.id != id || known_ != 0x3F) continue;
        for (std::size_t k = 0; k < 2; ++k) {
          require(load_le<std::int32_t>(&back.data[4 * k]) == stand_meant_[2 * pair + k],
                  "feedback");
        }
      }
    }
  }

  bool offset_;
  NodeBench bench_;
  bool synchronous_ = false;
  bool is_away_ = false;  // the drive of axis 1
  std::uint32_t sequence_ = 1;
  std::int64_t since_disabled_ = -1;  // us with targets; negative while enabled
  std::int64_t fades_within_ = kFadesWithin;
  Joints target_ = kStand;
  Joints stand_meant_ = kStand;
  Joints out_ = {};
  Joints delta_ = {};
  std::uint32_t fresh_ = 0;  // bit k: out_[k] is new
  std::uint32_t known_ = 0;  // bit k: the drive holds delta_[k], sent since the node's start
  std::array<double, 6> credit_ = {};
  std::array<std::uint64_t, 6> judged_us_ = {};
};

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static const storage::SimulatedFlash prepared = [] {
    NodeBench bench(true);
    bench.install(TestTable{.amplitude = kAmplitude, .magnitude = kMagnitude << 12}.image());
    return bench.flash;
  }();
  static const unsigned long steps = mask_of("ARMTRUE_FUZZ_STEPS");
  if (size < 3 || size > 64) return 0;
  Life life(prepared, data[0]);
  for (std::size_t at = 1; at + 1 < size; at += 2) {
    const auto step = static_cast<Step>(data[at] % static_cast<std::uint8_t>(Step::kCount));
    if ((steps >> static_cast<unsigned>(step) & 1U) == 0) continue;
    if (!life.carry_out(step, data[at + 1])) break;
  }
  return 0;
}
