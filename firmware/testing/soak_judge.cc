// The judge of the soak: checks all output against the table and what the drives hold.
#include <algorithm>
#include <cmath>
#include <cstdlib>

#include "firmware/testing/soak.h"
#include "firmware/testing/soak_facts.h"

namespace armtrue::canopen {

using namespace soak;

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
    // The fault interrupted the time for which the arm must stand still: the controller waits
    // again.
    interruptions_ = interruptions;
    return stand_still(kSettles);
  }
  const std::uint64_t gap = cycle_ - std::max(last_output_cycle_, disturbed_until_);
  figures_.longest_gap = std::max(figures_.longest_gap, gap);
  if (gap > 5) fail("no output although nothing is wrong any more");
}

// After a restart the node's counts begin at zero; the drives keep what they hold.
void Soak::begin_life() {
  if (bench_.lives == life_) return;
  life_ = bench_.lives;
  rate_clamped_ = 0;
  blends_from_ = 0;
  seen_ = {};
}

// `delta` is the correction sent to a joint. Its step is judged from what the drive holds.
void Soak::judge_joint(std::size_t joint, std::int32_t delta, std::int32_t commanded) {
  const std::string who = "joint " + std::to_string(joint + 1) + ": ";
  const double expected = expected_delta(commanded);
  const bool leaving = mode_ == Mode::kOffset && needs_healing_at_ != 0;
  const bool blending = blended_ <= blends_from_ + kBlendCycles;
  // Evaluations since this joint's last output; more than one if a full bus refused its frames.
  // Those before a restart are not known: at most one per cycle.
  const auto evaluations =
      static_cast<double>(leaving ? cycle_ - held_since_[joint] + 1 : blended_ - seen_[joint]);
  const double change = std::abs(static_cast<double>(delta) - last_delta_[joint]);
  const double error = std::abs(static_cast<double>(delta) - expected);
  // After a long silence the correction follows at the table's rate limit.
  const bool at_rate_limit = bench_.compensator().counters().rate_clamped != rate_clamped_;
  // A joint whose frames a full bus refused catches up at the rate limit.
  const std::uint32_t refused =
      bench_.downstream.counters().send_refused + bench_.upstream.counters().send_refused;
  if (refused != refused_by_any_) caught_up_at_ = cycle_ + kBlendCycles;
  refused_by_any_ = refused;
  const bool catches_up = cycle_ <= caught_up_at_;
  if (!blending && error > kSlack && !at_rate_limit && !catches_up) {
    return fail(who + "correction " + std::to_string(delta) + ", expected " +
                std::to_string(expected));
  }
  const double step = kBlendStep * evaluations + std::abs(expected - last_expected_[joint]);
  const bool follows = !catches_up && !leaving;
  if (blending && follows && !at_rate_limit && !was_at_rate_limit_ && change > step + kSlack) {
    return fail(who + "a step while blending in, " + std::to_string(last_delta_[joint]) + " to " +
                std::to_string(delta) + " in " + std::to_string(evaluations) +
                " evaluations, expected " + std::to_string(last_expected_[joint]) + " to " +
                std::to_string(expected));
  }
  if (std::abs(delta) > kPermitted) return fail(who + "more than the table permits");
  // Outputs that a full bus refused do not permit a larger step, however many they were.
  if (change > kRateLimit + kSlack) {
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
  // The frame of joint 1 identifies the pose; without it (a set cut short) the one due is assumed.
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
  // Blending continues with every evaluation, whether the bus accepted its output or not.
  blended_ = bench_.node().joint_counters().steps;
  const Joints commanded = targets_of(meant);
  if (is_new_life) {
    // The drives stand at their last output. The correction starts at the nearest permitted value:
    // the last correction itself if the controller waited.
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

// Offset mode: every frame with offsets is a step of the drives that receive it.
void Soak::judge_offsets() {
  std::size_t frames = 0;
  std::size_t zeros = 0;  // frames of zero offsets before all others
  const bool leaving = needs_healing_at_ != 0;
  for (const CanFrame& frame : bench_.upstream.take_sent()) {
    if (frame.id == 0x80 + NodeBench::kNodeId) ++figures_.emergencies;
    const auto* id = std::find(std::begin(kOffsetIds), std::end(kOffsetIds), frame.id);
    if (id == std::end(kOffsetIds)) continue;
    const bool is_zero =
        std::all_of(frame.data, frame.data + 8, [](int byte) { return byte == 0; });
    if (is_zero && zeros == frames) ++zeros;
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
  // NMT start does not cut a fade short: its last step and the first set may share a cycle.
  if (frames > (leaving || zeros >= 3 ? 6U : 3U)) {
    return fail("more than one set of offsets in a cycle");
  }
  whole_ = frames == 3 && !leaving;
  if (frames != 0) {
    was_at_rate_limit_ = bench_.compensator().counters().rate_clamped != rate_clamped_;
    rate_clamped_ = bench_.compensator().counters().rate_clamped;
    ++(whole_ ? figures_.outputs : figures_.partial);
    last_output_cycle_ = cycle_;
  }
  judge_gap(frames != 0);
}

// The drives follow the controller's targets, slightly late, and add the offset that they hold.
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
  // Exact only if the drives stand at the complete output of the last evaluation since the start.
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
