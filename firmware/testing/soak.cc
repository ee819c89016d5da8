#include "firmware/testing/soak.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <numbers>

#include "firmware/testing/soak_facts.h"
#include "firmware/testing/test_table.h"

namespace armtrue::canopen {

using namespace soak;

const char* name_of(Fault fault) {
  constexpr const char* kNames[] = {"lost target",
                                    "repeated target",
                                    "reordered targets",
                                    "late target",
                                    "corrupted target",
                                    "short target",
                                    "oversize target",
                                    "foreign frame",
                                    "lost SYNC",
                                    "jittered SYNC",
                                    "second master",
                                    "stray NMT",
                                    "stray SDO",
                                    "full bus",
                                    "upstream bus-off",
                                    "downstream bus-off",
                                    "lost frames",
                                    "power cycle",
                                    "silence"};
  static_assert(std::size(kNames) == kFaults);
  return kNames[static_cast<std::size_t>(fault)];
}

Soak::Soak(std::uint32_t seed, double rate, bool synchronous, Mode mode)
    : mode_(mode),
      bench_(mode == Mode::kInline, true),
      random_(seed),
      probability_(rate / 1000.0),
      synchronous_(synchronous) {
  configure();
  last_released_ = targets_of(pose_);
  stand_still(mode_ == Mode::kOffset ? kSettles : 3);
}

void Soak::configure() {
  bench_.install(TestTable{.magnitude = kPermitted << 12}.image());
  bench_.configure(mode_);
  if (synchronous_) bench_.set_transmission(0x1400);
  if (bench_.write(0x1010, 1, kSave, 4) != 0) throw std::runtime_error("cannot save");
  bench_.downstream.take_sent();
  bench_.upstream.take_sent();
  begin_us_ = bench_.now_us;
}

std::string Soak::run(std::uint64_t cycles) {
  for (std::uint64_t k = 0; k < cycles && failure_.empty(); ++k) one_cycle();
  return failure_;
}

void Soak::fail(const std::string& what) {
  if (!failure_.empty()) return;
  failure_ = "cycle " + std::to_string(cycle_) + ": " + what + "; NMT state " +
             std::to_string(static_cast<int>(bench_.node().nmt_state())) + "; lately:";
  for (const auto& [cycle, fault] : lately_) {
    failure_ += " " + std::to_string(cycle) + " " + name_of(fault) + ",";
  }
  failure_.back() = '.';
}

bool Soak::draw(Fault fault) {
  if (std::generate_canonical<double, 32>(random_) >= probability_) return false;
  ++figures_.faults[static_cast<std::size_t>(fault)];
  lately_.emplace_back(cycle_, fault);
  if (lately_.size() > 12) lately_.pop_front();
  return true;
}

Soak::Joints Soak::targets_of(std::uint64_t pose) const {
  Joints joints = {};
  joints[0] = static_cast<std::int32_t>(kStep * static_cast<std::int64_t>(pose));
  // Joints 3 to 6 rest in eight of sixteen cycles: their frames then repeat the targets before.
  const std::uint64_t moved = pose / 16 * 8 + std::min<std::uint64_t>(pose % 16, 8);
  for (std::size_t k = 1; k < joints.size(); ++k) {
    const std::uint64_t steps = k * (k < 2 ? pose : moved);
    joints[k] = static_cast<std::int32_t>(13 * static_cast<std::int64_t>(steps)) + 100000;
  }
  return joints;
}

void Soak::stand_still(std::uint64_t cycles) {
  standing_until_ = std::max(standing_until_, cycle_ + cycles);
  disturbed_until_ = std::max(disturbed_until_, standing_until_);
}

void Soak::deliver(const CanFrame& frame) {
  if (bench_.upstream.bus_state() != BusState::kBusOff) bench_.upstream.deliver(frame);
}

void Soak::step_to(std::uint64_t offset_us) {
  bench_.now_us = std::max(bench_.now_us, begin_us_ + cycle_ * 1000 + offset_us);
  bench_.turn();
}

void Soak::one_cycle() {
  ++cycle_;
  ++figures_.cycles;
  lagging_pose_ = previous_pose_;
  previous_pose_ = pose_;
  const bool stands = cycle_ < standing_until_;
  if (!stands) ++pose_;
  const auto disturbed = [this](std::uint64_t cycles) {
    disturbed_until_ = std::max(disturbed_until_, cycle_ + cycles);
  };
  auto& out = mode_ == Mode::kInline ? bench_.downstream : bench_.upstream;
  out.set_room(cycle_ < full_until_ ? random_() % 4 : SIZE_MAX);
  disturb();

  const bool silent = cycle_ < silent_until_;
  std::uint64_t sync_at_us = 0;
  if (draw(Fault::kJitteredSync)) {
    sync_at_us = random_() % 900;
    disturbed(3);
  }
  const bool lost_sync = draw(Fault::kLostSync);
  if (lost_sync) disturbed(3);

  std::vector<CanFrame> frames;
  if (!silent) {
    const auto targets = NodeBench::targets(targets_of(pose_));
    frames.assign(targets.begin(), targets.end());
  }
  // At times targets come in the second half of the SYNC interval, where an incomplete set has not
  // yet ended by its time when the next SYNC comes. The frame of joint 1, which never rests, is
  // then the last: if it slips behind SYNC, the others repeat the targets before.
  const bool is_late_in_cycle = !synchronous_ && mode_ == Mode::kInline && cycle_ / 1000 % 2 != 0;
  if (is_late_in_cycle) std::reverse(frames.begin(), frames.end());
  // Targets carry no number (docs/security.md): a late frame cannot be told from a lost one of the
  // next cycle that it replaces, nor a second master's frame from a missing one of ours. So the
  // second master sends only while no other fault acts.
  const bool sync_is_odd = lost_sync || sync_at_us > 0;
  const bool second_master =
      cycle_ > disturbed_until_ && !sync_is_odd && draw(Fault::kSecondMaster);
  std::vector<CanFrame> late = std::move(late_);
  late_.clear();
  const auto may_vanish = [&](const CanFrame& frame) {
    return !second_master && std::none_of(late.begin(), late.end(),
                                          [&](const CanFrame& l) { return l.id == frame.id; });
  };
  if (!frames.empty()) {
    if (draw(Fault::kReorderedTargets)) std::shuffle(frames.begin(), frames.end(), random_);
    const std::size_t victim = random_() % frames.size();
    if (draw(Fault::kRepeatedTarget)) {
      frames.insert(frames.begin() + static_cast<std::ptrdiff_t>(random_() % (frames.size() + 1)),
                    frames[victim]);
      disturbed(3);
    }
    if (draw(Fault::kCorruptedTarget)) {
      // Arbitration starts again: the frame follows those that waited.
      const CanFrame frame = frames[victim];
      frames.erase(frames.begin() + static_cast<std::ptrdiff_t>(victim));
      frames.push_back(frame);
    }
    if (draw(Fault::kOversizeTarget) && !stands) {
      constexpr std::uint8_t kLengths[] = {12, 16, 20, 24, 32, 48, 64};
      const std::uint8_t length = kLengths[random_() % std::size(kLengths)];
      const std::uint32_t id = frames[victim].id;
      std::array<std::uint8_t, kFdPayload> beyond = {};
      for (std::uint8_t& byte : beyond) byte = static_cast<std::uint8_t>(random_());
      for (CanFrame& frame : frames) {
        if (frame.id != id) continue;
        frame.flags = kFrameFd | kFrameBitRateSwitch;
        frame.len = length;
        std::copy(beyond.begin() + 8, beyond.begin() + length, frame.data + 8);
      }
    }
    if (draw(Fault::kShortTarget) && !stands && may_vanish(frames[victim])) {
      const std::uint32_t id = frames[victim].id;
      for (CanFrame& frame : frames) {
        if (frame.id != id) continue;
        frame.flags = kFrameNone;
        frame.len = static_cast<std::uint8_t>(random_() % 8);
      }
      disturbed(3);
    }
    if (draw(Fault::kLostTarget) && may_vanish(frames[victim])) {
      const std::uint32_t id = frames[victim].id;
      std::erase_if(frames, [id](const CanFrame& frame) { return frame.id == id; });
      disturbed(3);
    } else if (draw(Fault::kLateTarget) && may_vanish(frames[victim])) {
      const CanFrame frame = frames[victim];
      std::erase_if(frames, [&](const CanFrame& other) { return other.id == frame.id; });
      if (frame.len >= 8) late_.push_back(frame);
      disturbed(4);
    }
  }
  for (const CanFrame& frame : frames) sent_[pose_ % sent_.size()][frame.id / 0x100 - 2] = frame;
  if (!late.empty()) {
    frames.insert(frames.begin(), late.begin(), late.end());
    disturbed(3);
  }
  if (draw(Fault::kForeignTarget)) {
    CanFrame foreign = NodeBench::targets(targets_of(pose_ + 99))[random_() % 3];
    foreign.flags = random_() % 2 == 0 ? kFrameExtended : kFrameRemote;
    frames.insert(frames.begin(), foreign);
    expected_forward_.push_back(foreign);
  }
  if (second_master) {
    const auto theirs =
        NodeBench::targets({static_cast<std::int32_t>(kStrangerTarget), 1, 2, 3, 4, 5});
    // Asynchronous targets are sent on with the last frame of the set. A second master's frame
    // ahead of ours would count as ours (docs/security.md), so there its frames follow ours. While
    // we are silent it sends none: a complete set of its frames would be a valid set.
    const std::size_t count = 1 + random_() % 3;
    if (!silent) {
      const std::size_t at = !synchronous_ ? frames.size() : random_() % (frames.size() + 1);
      frames.insert(frames.begin() + static_cast<std::ptrdiff_t>(at), theirs.begin(),
                    theirs.begin() + static_cast<std::ptrdiff_t>(count));
    }
    disturbed(3);
  }
  const int others = cycle_ < full_until_ ? 6 : 2;
  for (int k = 0; k < others; ++k) {
    CanFrame other;
    other.id = static_cast<std::uint32_t>(0x500U + random_() % 0x80U);
    other.len = static_cast<std::uint8_t>(random_() % 9);
    for (std::size_t byte = 0; byte < other.len; ++byte) {
      other.data[byte] = static_cast<std::uint8_t>(random_());
    }
    frames.insert(frames.begin() + static_cast<std::ptrdiff_t>(random_() % (frames.size() + 1)),
                  other);
    expected_forward_.push_back(other);
  }
  // Insertion mixed both kinds of frames; those expected to pass are in the order of `frames`.
  std::erase_if(expected_forward_, [](const CanFrame&) { return true; });
  for (const CanFrame& frame : frames) {
    if (!is_target(frame)) expected_forward_.push_back(frame);
  }

  bool sync_due = !lost_sync && !silent;
  std::uint64_t at_us = 50;
  if (is_late_in_cycle) {
    if (sync_due && sync_at_us == 0) deliver(make_frame(0x80, {}));
    sync_due = sync_due && sync_at_us != 0;
    for (; at_us < 400; at_us += 150) step_to(at_us);
  }
  for (const CanFrame& frame : frames) {
    if (sync_due && at_us >= sync_at_us) {
      deliver(make_frame(0x80, {}));
      sync_due = false;
    }
    deliver(frame);
    step_to(at_us);
    at_us += 60;
  }
  if (sync_due) deliver(make_frame(0x80, {}));
  // A real node reads its clock continuously.
  for (; at_us < 990; at_us += 150) step_to(at_us);
  step_to(990);
  if (mode_ == Mode::kInline) {
    judge_downstream();
    judge_feedback();
  } else {
    judge_offsets();
    judge_offset_feedback();
  }
  heal();
}

void Soak::disturb() {
  const auto for_some = [this](std::uint64_t least, std::uint64_t most) {
    return cycle_ + least + random_() % (most - least);
  };
  if (draw(Fault::kSilence)) {
    silent_until_ = for_some(5, 300);
    disturbed_until_ = std::max(disturbed_until_, silent_until_ + 3);
  }
  if (draw(Fault::kFullBus)) {
    full_until_ = for_some(2, 40);
    disturbed_until_ = std::max(disturbed_until_, full_until_ + 3);
  }
  const std::uint64_t recovered = cycle_ + BusWatch::kRecoveryPauseUs / 1000 + 5;
  if (draw(Fault::kUpstreamOff)) {
    bench_.upstream.set_state(BusState::kBusOff);
    disturbed_until_ = std::max(disturbed_until_, recovered);
  }
  if (draw(Fault::kDownstreamOff)) {
    bench_.downstream.set_state(BusState::kBusOff);
    disturbed_until_ = std::max(disturbed_until_, recovered);
  }
  if (draw(Fault::kLostFrames))
    bench_.upstream.lose_frames(static_cast<std::uint32_t>(1 + random_() % 5));
  if (draw(Fault::kPowerCycle)) {
    bench_.power_on();
    needs_healing_at_ = for_some(5, 100);
    disturbed_until_ = std::max(disturbed_until_, needs_healing_at_ + 3);
    // Some controllers notice and wait, others continue.
    if (random_() % 2 == 0) stand_still(needs_healing_at_ + 5 - cycle_);
  }
  if (draw(Fault::kStrayNmt)) {
    constexpr int kCommands[] = {1, 2, 128, 129, 130, 77};
    const int node = random_() % 2 == 0 ? 0 : NodeBench::kNodeId;
    const int command = kCommands[random_() % std::size(kCommands)];
    deliver(make_frame(0, {command, node}));
    bench_.turn();
    const bool arrives = bench_.upstream.bus_state() != BusState::kBusOff;
    awaits_boot_ = awaits_boot_ || (arrives && (command == 129 || command == 130));
    needs_healing_at_ = for_some(2, 100);
    disturbed_until_ = std::max(disturbed_until_, needs_healing_at_ + 3);
  }
  if (draw(Fault::kStraySdo)) stray_sdo();
}

void Soak::heal() {
  if (needs_healing_at_ == 0 || cycle_ < needs_healing_at_) return;
  if (bench_.upstream.bus_state() == BusState::kBusOff) {
    disturbed_until_ = std::max(disturbed_until_, cycle_ + 4);
    return;
  }
  // A reset waits until the corrections are zero; the controller starts the node after its boot-up.
  if (awaits_boot_ && bench_.node().nmt_state() == NmtState::kOperational) {
    disturbed_until_ = std::max(disturbed_until_, cycle_ + 4);
    return;
  }
  awaits_boot_ = false;
  needs_healing_at_ = 0;
  bench_.start_nodes();
  if (mode_ == Mode::kOffset) blends_from_ = bench_.node().joint_counters().steps;
  // The node can find out what the drives hold only while the arm stands.
  if (mode_ == Mode::kOffset) stand_still(kSettles);
}

// Requests that a confused or hostile client could send. None may reach the joint path.
void Soak::stray_sdo() {
  const int count = 1 + static_cast<int>(random_() % 6);
  for (int k = 0; k < count; ++k) {
    CanFrame frame;
    frame.id = 0x600 + NodeBench::kNodeId;
    frame.len = 8;
    for (std::uint8_t& byte : std::span(frame.data).first(8))
      byte = static_cast<std::uint8_t>(random_());
    // Objects of every kind, except those whose legal effect is to stop or change the output.
    constexpr std::uint16_t kObjects[] = {0x1000, 0x1001, 0x1008, 0x1018, 0x1200, 0x1400,
                                          0x1600, 0x1A00, 0x2001, 0x2010, 0x2011, 0x2012,
                                          0x2013, 0x2014, 0x2020, 0x2030, 0x6041, 0x6064,
                                          0x607A, 0x60B0, 0x7777, 0x0000, 0xFFFF};
    store_le(&frame.data[1], kObjects[random_() % std::size(kObjects)]);
    frame.data[3] = static_cast<std::uint8_t>(random_() % 4);
    if (random_() % 8 == 0) frame.len = static_cast<std::uint8_t>(random_() % 8);
    deliver(frame);
    bench_.turn();
  }
}

}  // namespace armtrue::canopen
