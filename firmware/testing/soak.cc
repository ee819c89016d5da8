#include "firmware/testing/soak.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <numbers>

#include "firmware/testing/test_table.h"

namespace armtrue::canopen {
namespace {

// Joint 1 moves further in a cycle than any correction is large: its target tells the cycle.
constexpr std::int32_t kStep = 400;
constexpr std::int32_t kPermitted = 190;  // a little more than the largest that is right
constexpr double kIncrementsPerTurn = 1 << 20;
// amplitude 2^22: 2^-10 rad
constexpr double kAmplitude = kIncrementsPerTurn / (1024.0 * 2.0 * std::numbers::pi);
constexpr std::uint64_t kBlendCycles = 25;
constexpr double kBlendStep = 18.0;    // from one end of the permitted to the other, in one cycle
constexpr double kRateLimit = 104.86;  // 0.1 turn per second: increments a cycle
constexpr double kSlack = 1.6;         // rounding here and there, and the inverse's second order
constexpr std::uint32_t kStrangerTarget = 0x40000000;

constexpr std::uint32_t kTargetIds[] = {0x220, 0x320, 0x420};
constexpr std::uint32_t kFeedbackIds[] = {0x1C0, 0x1C1, 0x1C2};
constexpr std::uint32_t kOffsetIds[] = {0x1A0, 0x2A0, 0x3A0};
constexpr std::uint64_t kSettles = 135;  // cycles until an arm that stands is known to

bool is_target(const CanFrame& frame) {
  return !frame.is(kFrameExtended) && !frame.is(kFrameRemote) &&
         std::find(std::begin(kTargetIds), std::end(kTargetIds), frame.id) != std::end(kTargetIds);
}

bool equal(const CanFrame& one, const CanFrame& other) {
  return one.id == other.id && one.flags == other.flags && one.len == other.len &&
         std::equal(one.data, one.data + one.len, other.data);
}

double expected_delta(std::int32_t target) {
  return -kAmplitude * std::sin(2.0 * std::numbers::pi * target / kIncrementsPerTurn);
}

}  // namespace

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
  for (std::uint16_t k = 0; k < 3 && mode_ == Mode::kOffset; ++k) {
    if (bench_.write(static_cast<std::uint16_t>(0x1800 + k), 1, 0x40000000U | kOffsetIds[k], 4) !=
        0) {
      throw std::runtime_error("cannot configure");
    }
  }
  bench_.configure(mode_);
  for (std::uint16_t k = 0; k < 3 && synchronous_; ++k) {
    if (bench_.write(static_cast<std::uint16_t>(0x1400 + k), 2, 1, 1) != 0) {
      throw std::runtime_error("cannot configure");
    }
  }
  if (bench_.write(0x1010, 1, 0x65766173, 4) != 0) throw std::runtime_error("cannot save");
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
  for (std::size_t k = 1; k < joints.size(); ++k) {
    joints[k] = static_cast<std::int32_t>(13 * static_cast<std::int64_t>(k * pose)) + 100000;
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
  // A late frame that stands in for the lost one of the next cycle cannot be told from it: targets
  // carry no number (docs/security.md). Nor can a stranger's frame in place of a missing one of
  // ours; strangers come while nothing else is wrong.
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
      // Arbitration begins anew: the frame comes after those that waited.
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
    // Asynchronous targets leave with the last frame of the set: a stranger's frame ahead of ours
    // would have stood for it (docs/security.md), so there strangers come behind us. A whole set of
    // theirs is a set, where we are silent.
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
  // Insertion shuffled the two kinds among each other; what is expected through is in frame order.
  std::erase_if(expected_forward_, [](const CanFrame&) { return true; });
  for (const CanFrame& frame : frames) {
    if (!is_target(frame)) expected_forward_.push_back(frame);
  }

  bool sync_due = !lost_sync && !silent;
  std::uint64_t at_us = 50;
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
  // A real node looks at its clock all the time.
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
    // Some controllers notice, others go on.
    if (random_() % 2 == 0) stand_still(needs_healing_at_ + 5 - cycle_);
  }
  if (draw(Fault::kStrayNmt)) {
    constexpr int kCommands[] = {1, 2, 128, 129, 130, 77};
    const int node = random_() % 2 == 0 ? 0 : NodeBench::kNodeId;
    const CanFrame frame = make_frame(0, {kCommands[random_() % std::size(kCommands)], node});
    deliver(frame);
    bench_.turn();
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
  needs_healing_at_ = 0;
  bench_.start_nodes();
  if (mode_ == Mode::kOffset) blends_from_ = bench_.node().joint_counters().steps;
  // What the drives hold can only be heard of an arm that stands.
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
    // Objects of every kind; those whose legal effect is to stop or change the output are left
    // alone.
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

Soak::Joints Soak::unpack(const CanFrame& frame) const {
  Joints joints = {};
  joints[0] = load_le<std::int32_t>(&frame.data[0]);
  joints[1] = load_le<std::int32_t>(&frame.data[4]);
  return joints;
}

void Soak::judge_downstream() {
  std::vector<CanFrame> set;
  std::size_t next = 0;
  for (const CanFrame& frame : bench_.downstream.take_sent()) {
    if (is_target(frame)) {
      set.push_back(frame);
      continue;
    }
    if (frame.id == 0x80 || frame.id == 0x000) continue;
    while (next < expected_forward_.size() && !equal(expected_forward_[next], frame)) ++next;
    if (next == expected_forward_.size()) return fail("a frame came through that nobody sent");
    ++next;
    ++figures_.forwarded;
  }
  expected_forward_.clear();
  judge_set(set);
  judge_gap(!set.empty());
}

void Soak::judge_gap(bool any_output) {
  if (any_output || cycle_ <= disturbed_until_) return;
  std::uint64_t interruptions = 1;
  for (const Fault fault : {Fault::kSilence, Fault::kUpstreamOff, Fault::kPowerCycle,
                            Fault::kStrayNmt, Fault::kSecondMaster}) {
    interruptions += figures_.faults[static_cast<std::size_t>(fault)];
  }
  if (mode_ == Mode::kOffset && interruptions != interruptions_) {
    // The time in which the arm would have been known to stand was spoilt: a controller waits
    // again.
    interruptions_ = interruptions;
    return stand_still(kSettles);
  }
  const std::uint64_t gap = cycle_ - std::max(last_output_cycle_, disturbed_until_);
  figures_.longest_gap = std::max(figures_.longest_gap, gap);
  if (gap > 5) fail("no output although nothing is wrong any more");
}

// A node that has just started does not know what the drives hold; they do.
void Soak::begin_life() {
  if (bench_.lives == life_) return;
  life_ = bench_.lives;
  rate_clamped_ = 0;
  blends_from_ = 0;
  seen_ = {};
}

// `delta` is what a joint is told beyond its command. Steps are judged from what its drive holds.
void Soak::judge_joint(std::size_t joint, std::int32_t delta, std::int32_t commanded) {
  const std::string who = "joint " + std::to_string(joint + 1) + ": ";
  const double expected = expected_delta(commanded);
  const bool leaving = mode_ == Mode::kOffset && needs_healing_at_ != 0;
  const bool blending = blended_ <= blends_from_ + kBlendCycles;
  // Evaluations since this joint's last output; more than one where a full bus took no more.
  // Those of a life that has ended meanwhile are not known: at most one in a cycle.
  const auto evaluations =
      static_cast<double>(leaving ? cycle_ - held_since_[joint] + 1 : blended_ - seen_[joint]);
  const double change = std::abs(static_cast<double>(delta) - last_delta_[joint]);
  const double error = std::abs(static_cast<double>(delta) - expected);
  // After a long silence the correction follows at the table's rate limit.
  const bool at_rate_limit = bench_.compensator().counters().rate_clamped != rate_clamped_;
  if (!blending && error > kSlack && !at_rate_limit) {
    return fail(who + "correction " + std::to_string(delta) + ", expected " +
                std::to_string(expected));
  }
  const double step = kBlendStep * evaluations + std::abs(expected - last_expected_[joint]);
  if (blending && !leaving && !at_rate_limit && !was_at_rate_limit_ && change > step + kSlack) {
    return fail(who + "a step while blending in, " + std::to_string(last_delta_[joint]) + " to " +
                std::to_string(delta) + " in " + std::to_string(evaluations) +
                " evaluations, expected " + std::to_string(last_expected_[joint]) + " to " +
                std::to_string(expected));
  }
  if (std::abs(delta) > kPermitted) return fail(who + "more than the table permits");
  if (change > kRateLimit * evaluations + kSlack) {
    return fail(who + "faster than the rate limit: " + std::to_string(last_delta_[joint]) + " to " +
                std::to_string(delta) + " in " + std::to_string(evaluations) + " evaluations");
  }
  last_delta_[joint] = delta;
  held_since_[joint] = cycle_;
  last_expected_[joint] = expected;
  seen_[joint] = blended_;
}

void Soak::judge_set(std::vector<CanFrame>& set) {
  const bool evaluates = bench_.node().joint_counters().steps != 0;
  const bool is_first = evaluates && evaluated_life_ != bench_.lives;
  if (is_first) {
    evaluated_life_ = bench_.lives;
    first_pose_ = synchronous_ ? previous_pose_ : pose_;
  }
  if (set.empty()) return;
  if (set.size() > 3) return fail("more than one set in a cycle");
  Joints released = last_released_;
  // Which pose? The frame of joint 1 tells; without it (cut short) any of late may be meant.
  const auto first =
      std::find_if(set.begin(), set.end(), [](const CanFrame& f) { return f.id == 0x220; });
  std::uint64_t meant = synchronous_ ? previous_pose_ : pose_;
  if (first != set.end()) {
    const std::int32_t value = unpack(*first)[0];
    meant = static_cast<std::uint64_t>(std::llround(static_cast<double>(value) / kStep));
    if (std::abs(value - kStep * static_cast<std::int64_t>(meant)) > kPermitted) {
      return fail("joint 1 is told " + std::to_string(value) + ", which no pose meant");
    }
  }
  if (meant > pose_ || meant + 2 < pose_) return fail("output of pose " + std::to_string(meant));
  const bool may_repeat = cycle_ < standing_until_ + 3;
  if (has_output_ && meant < last_output_pose_ + (may_repeat ? 0 : 1)) {
    return fail("output repeated or out of order");
  }
  const bool is_new_life = bench_.lives != life_;
  begin_life();
  // Blending goes on with every evaluation, whether the bus took its output or not.
  blended_ = bench_.node().joint_counters().steps;
  const Joints commanded = targets_of(meant);
  if (is_new_life) {
    // The drives stand where they were told last. From there the nearest that is permitted: that
    // itself where the controller waited for us.
    const bool waited = has_output_ && meant == last_output_pose_;
    const Joints began = targets_of(is_first ? meant : first_pose_);
    for (std::size_t joint = 0; joint < commanded.size(); ++joint) {
      const std::int32_t stand = last_released_[joint] - began[joint];
      const std::int32_t nearest = std::clamp(stand, -kPermitted, kPermitted);
      if (waited && whole_ && nearest != last_delta_[joint])
        return fail("the judge has lost count");
      last_delta_[joint] = nearest;
      last_expected_[joint] = expected_delta(commanded[joint]);
    }
  }
  for (const CanFrame& frame : set) {
    const CanFrame& original = sent(meant, frame.id);
    if (frame.len != original.len || frame.flags != original.flags ||
        !std::equal(frame.data + 8, frame.data + std::max<std::size_t>(frame.len, 8),
                    original.data + 8)) {
      return fail("a target frame changed in more than its target");
    }
    const std::size_t pair = frame.id / 0x100 - 2;
    for (std::size_t place = 0; place < 2; ++place) {
      const std::size_t joint = 2 * pair + place;
      released[joint] = load_le<std::int32_t>(&frame.data[4 * place]);
      judge_joint(joint, released[joint] - commanded[joint], commanded[joint]);
    }
  }
  was_at_rate_limit_ = bench_.compensator().counters().rate_clamped != rate_clamped_;
  rate_clamped_ = bench_.compensator().counters().rate_clamped;
  if (set.size() == 3) {
    ++figures_.outputs;
    last_commanded_ = commanded;
    whole_ = true;
  } else {
    ++figures_.partial;
    whole_ = false;
    if (bench_.downstream.counters().send_refused == refused_)
      return fail("a set came out in part");
  }
  refused_ = bench_.downstream.counters().send_refused;
  evaluated_ = bench_.node().joint_counters().sets;
  last_released_ = released;
  last_output_cycle_ = cycle_;
  last_output_pose_ = meant;
  has_output_ = true;
}

// Offset mode: every frame with offsets is a step of the drives that get it.
void Soak::judge_offsets() {
  std::size_t frames = 0;
  const bool leaving = needs_healing_at_ != 0;
  for (const CanFrame& frame : bench_.upstream.take_sent()) {
    if (frame.id == 0x80 + NodeBench::kNodeId) ++figures_.emergencies;
    const auto* id = std::find(std::begin(kOffsetIds), std::end(kOffsetIds), frame.id);
    if (id == std::end(kOffsetIds)) continue;
    ++frames;
    begin_life();
    blended_ = bench_.node().joint_counters().steps;
    if (leaving) blends_from_ = blended_;
    const auto pair = static_cast<std::size_t>(id - std::begin(kOffsetIds));
    const Joints commanded = targets_of(synchronous_ ? previous_pose_ : pose_);
    for (std::size_t place = 0; place < 2; ++place) {
      const std::size_t joint = 2 * pair + place;
      const auto offset = load_le<std::int32_t>(&frame.data[4 * place]);
      judge_joint(joint, offset, commanded[joint]);
    }
  }
  if (frames > (leaving ? 6U : 3U)) return fail("more than one set of offsets in a cycle");
  whole_ = frames == 3 && !leaving;
  if (frames != 0) {
    was_at_rate_limit_ = bench_.compensator().counters().rate_clamped != rate_clamped_;
    rate_clamped_ = bench_.compensator().counters().rate_clamped;
    ++(whole_ ? figures_.outputs : figures_.partial);
    last_output_cycle_ = cycle_;
  }
  judge_gap(frames != 0);
}

// The drives follow the controller's targets, a little late, and add the offset that they have.
void Soak::judge_offset_feedback() {
  const Joints followed = targets_of(lagging_pose_);
  Joints stand = followed;
  for (std::size_t joint = 0; joint < stand.size(); ++joint) stand[joint] += last_delta_[joint];
  for (std::size_t pair = 0; pair < 3; ++pair) {
    deliver(NodeBench::pair_frame(kFeedbackIds[pair], stand[2 * pair], stand[2 * pair + 1]));
    bench_.turn();
  }
  if (!whole_ || bench_.upstream.bus_state() == BusState::kBusOff) return;
  for (std::size_t joint = 0; joint < stand.size(); ++joint) {
    const auto& value = od::axis::kPositionActualValue[joint];
    if (bench_.node().dictionary().get(value) != followed[joint]) {
      return fail("joint " + std::to_string(joint + 1) + " is not read as it was commanded");
    }
    ++figures_.feedback_checked;
  }
}

void Soak::judge_feedback() {
  for (std::size_t pair = 0; pair < 3; ++pair) {
    bench_.from_drives(NodeBench::pair_frame(kFeedbackIds[pair], last_released_[2 * pair],
                                             last_released_[2 * pair + 1]));
  }
  // Exact only where the drives stand on what the last evaluation of this life released as a whole.
  const bool exact = whole_ && has_output_ && bench_.lives == life_ &&
                     bench_.node().joint_counters().sets == evaluated_;
  for (const CanFrame& frame : bench_.upstream.take_sent()) {
    if (frame.id == 0x80 + NodeBench::kNodeId) ++figures_.emergencies;
    const auto* id = std::find(std::begin(kFeedbackIds), std::end(kFeedbackIds), frame.id);
    if (id == std::end(kFeedbackIds) || !exact) continue;
    const auto pair = static_cast<std::size_t>(id - std::begin(kFeedbackIds));
    for (std::size_t place = 0; place < 2; ++place) {
      const std::size_t joint = 2 * pair + place;
      if (load_le<std::int32_t>(&frame.data[4 * place]) != last_commanded_[joint]) {
        return fail("joint " + std::to_string(joint + 1) + " comes back as it was not commanded");
      }
      ++figures_.feedback_checked;
    }
  }
}

}  // namespace armtrue::canopen
