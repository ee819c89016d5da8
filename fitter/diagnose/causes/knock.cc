#include <algorithm>
#include <cmath>
#include <cstdio>

#include "fitter/diagnose/causes/causes.h"
#include "fitter/effects/effect.h"
#include "fitter/effects/tables.h"

namespace armtrue {
namespace {

// Times tried over all rows, and in each refinement around the best of them.
constexpr int kTimesTried = 30, kTimesAround = 16;
// With fewer rows before or after it, a step can be a few gross errors.
constexpr std::size_t kLeastRows = 12;
// Largest displacement of a tracker, as the effect `station` allows; half the step, which goes from
// minus to plus.
constexpr double kFurthest = 1.5e-3, kLargest = 1e-3;  // [m], [rad]
// Largest displacement of a loose reflector, and deflection of joints under another load; half the
// step.
constexpr double kLoosest = 5e-4, kSag = 1.5e-3;  // [m], [rad or m]
// Nodes over time of a smooth course, and the share of its gain that a step must reach. Beyond a
// line, drifts that turn back gave 0.51 to 0.68, steps 1.6 and more, and a load that was off again
// for the last rows 0.89 to 1.4: chosen between the two on those campaigns.
constexpr std::size_t kCourseNodes = 7;
constexpr double kShareOfCourse = 0.8;
// In a pause of this length the instrument may have been set up anew [s]. Ours: trackers are seldom
// left alone for an hour with the work unfinished, and drift little in less. With more pauses than
// this, the arm was measured now and then, by an instrument that stayed.
constexpr double kLongPause = 3600.0;
constexpr std::size_t kMostPauses = 6;

// One coordinate that an event displaces, on one frame or on several equally.
struct MovedCoordinate {
  std::vector<Coordinate> on;
  std::string factor;  // multiplies the function of time; empty: 1
  std::string unit;
  double bound = 0.0;
};

// All coordinates that an event displaces; translations or joints, whichever it has, come first.
using Frame = std::vector<MovedCoordinate>;

Frame base_frame() {
  Frame frame;
  for (int c = 0; c < 6; ++c)
    frame.push_back({{on_base(c)}, "", c < 3 ? "m" : "rad", c < 3 ? kFurthest : kLargest});
  return frame;
}

// Reflectors `first` to `last`, all displaced equally in the flange's frame.
Frame reflectors(int first, int last) {
  Frame frame;
  for (int c = 0; c < 3; ++c) {
    MovedCoordinate moved{{}, "", "m", kLoosest};
    for (int t = first; t <= last; ++t) moved.on.push_back({Place::kTool, t, c});
    frame.push_back(std::move(moved));
  }
  return frame;
}

// Torque about a joint of a unit mass at the payload's point, from the last link's regressors,
// which need no recorded payload.
std::string lever_of_payload(const State& state, int joint) {
  const Robot& robot = state.robot();
  const Eigen::Vector3d point = robot.end * state.payload_point();
  const std::string stem =
      "u_" + std::to_string(joint) + "_" + std::to_string(robot.joint_count()) + "_";
  std::string lever = "(" + stem + "m";
  for (int axis = 0; axis < 3; ++axis)
    lever += " + " + Expression::number(point[axis]).to_string() + "*" + stem + "xyz"[axis];
  return lever + ")";
}

double largest_over_rows(const State& state, const std::string& expression) {
  double largest = 0.0;
  for (const double v : state.values(Expression::parse(expression)))
    largest = std::max(largest, std::abs(v));
  return largest;
}

// An unrecorded change of the load at the tool: it deflects every joint that carries gravity, in
// proportion to the torque of a unit mass about that joint.
Frame load_frame(const EffectContext& context) {
  Frame frame;
  for (const int k : gravity_loaded_joints(context)) {
    const std::string lever = lever_of_payload(context.state, k);
    const double largest = largest_over_rows(context.state, lever);
    if (largest > 0.0)
      frame.push_back({{motor(k)}, lever, motor_unit(context, k) + "/kg", kSag / largest});
  }
  return frame;
}

// What an event may displace: the base, the reflectors together and each by itself, and the load,
// if no change of it is recorded.
std::vector<Frame> frames_of(const Fit& fit) {
  std::vector<Frame> frames{base_frame()};
  const int targets = fit.measurements().targets;
  frames.push_back(reflectors(0, targets - 1));
  for (int t = 0; targets > 1 && t < targets; ++t) frames.push_back(reflectors(t, t));
  if (!payload_varies(fit.state())) frames.push_back(load_frame(fit.context()));
  std::erase_if(frames, [](const Frame& frame) { return frame.empty(); });
  return frames;
}

// Each coordinate of a frame times each function of time. A load also gets a constant, because the
// fit has no coefficient for its mean, as it has for base and reflectors.
Block block_of(const Frame& frame, std::vector<std::string> courses) {
  if (!frame.front().factor.empty()) courses.push_back("1");
  Block block{{"custom", {}, {}}, {}, 1};
  for (const std::string& course : courses) {
    for (const MovedCoordinate& moved : frame) {
      const std::string basis = moved.factor.empty() ? course : course + "*" + moved.factor;
      Parameter p = single_term("custom", {}, "structure_" + to_string(moved.on.front(), 2),
                                moved.unit, moved.bound, moved.on.front(), basis);
      for (std::size_t i = 1; i < moved.on.size(); ++i) {
        p.terms.push_back(p.terms.front());
        p.terms.back().coordinate = moved.on[i];
      }
      block.terms.parameters.push_back(std::move(p));
    }
  }
  return block;
}

std::string step_at(double time) {
  return "sign(time - " + Expression::number(time).to_string() + ")";
}

// Times halfway between consecutive rows, evenly over rows `low` to `high` of the sorted times in
// `count` intervals.
std::vector<double> times_between(const std::vector<double>& sorted, std::size_t low,
                                  std::size_t high, int count) {
  std::vector<double> times;
  for (int i = 0; i <= count; ++i) {
    const std::size_t at =
        low + (high - low) * static_cast<std::size_t>(i) / static_cast<std::size_t>(count);
    if (sorted[at] <= sorted[at - 1]) continue;  // readings of one visit
    const double time = (sorted[at - 1] + sorted[at]) / 2.0;
    if (times.empty() || time > times.back()) times.push_back(time);
  }
  return times;
}

// The middle of each long pause in the sorted times; none where a column names the set-ups, or
// where pauses are too many to be changes of the set-up.
std::vector<double> long_pauses(const State& state, const std::vector<double>& sorted) {
  std::vector<double> middle;
  if (state.recorded("station")) return middle;
  for (std::size_t i = kLeastRows; i + kLeastRows <= sorted.size(); ++i) {
    if (sorted[i] - sorted[i - 1] >= kLongPause)
      middle.push_back((sorted[i] + sorted[i - 1]) / 2.0);
  }
  if (middle.size() > kMostPauses) middle.clear();
  return middle;
}

struct BestStep {
  const Frame* frame = nullptr;
  double time = 0.0;
  BlockScore score;
};

BestStep best_of(const Scorer& scorer, const Frame& frame, const std::vector<double>& times) {
  std::vector<Block> blocks;
  for (const double time : times) blocks.push_back(block_of(frame, {step_at(time)}));
  const std::vector<BlockScore> scores = scorer.score(blocks, false);
  BestStep best{&frame, 0.0, {}};
  for (std::size_t i = 0; i < scores.size(); ++i) {
    if (scores[i].gain > best.score.gain) best = {&frame, times[i], scores[i]};
  }
  return best;
}

// Frame and time of the likeliest step. `sorted`: times of all rows, ascending.
BestStep likeliest_step(const Scorer& scorer, const std::vector<Frame>& frames,
                        const std::vector<double>& sorted) {
  const std::size_t first = kLeastRows, last = sorted.size() - kLeastRows;
  BestStep best;
  for (const Frame& frame : frames) {
    BestStep of_frame = best_of(scorer, frame, times_between(sorted, first, last, kTimesTried));
    if (of_frame.score.delta_bic >= 0.0) continue;
    // `cell`: rows between neighbouring times of the last round.
    for (std::size_t cell = (last - first) / kTimesTried; cell > 0;
         cell = 2 * cell / kTimesAround) {
      const auto place = static_cast<std::size_t>(std::ranges::upper_bound(sorted, of_frame.time) -
                                                  sorted.begin());
      BestStep around = best_of(scorer, frame,
                                times_between(sorted, std::max(first + cell, place) - cell,
                                              std::min(last, place + cell), kTimesAround));
      if (around.score.gain > of_frame.score.gain) of_frame = std::move(around);
    }
    if (of_frame.score.delta_bic < best.score.delta_bic) best = std::move(of_frame);
  }
  return best;
}

// True if a smooth course of the same coordinates over time explains clearly more than the step, as
// for a drift that turns back. The step may have a straight line beside it, which is a drift too.
bool is_smooth_course(const Scorer& scorer, const BestStep& step, const std::vector<double>& time) {
  const std::vector<double> nodes = nodes_over(time, 1e9, kCourseNodes);
  std::vector<std::string> courses;
  for (std::size_t i = 1; i < nodes.size(); ++i)
    courses.push_back(hat_expression("time", nodes, i));
  const std::vector<BlockScore> scores = scorer.score(
      {block_of(*step.frame, {"time"}), block_of(*step.frame, {"time", step_at(step.time)}),
       block_of(*step.frame, courses)},
      false);
  const double line = scores[0].gain, stepped = scores[1].gain;
  // Each additional degree of freedom explains one variance of noise.
  const double course = scores[2].gain - std::max(0, scores[2].degrees - scores[1].degrees);
  return stepped - line < kShareOfCourse * (course - line);
}

// "a step of 220 um near time = 2.5e+03"
std::string words_of_step(const BestStep& step, double largest) {
  const std::vector<double>& by = step.score.coefficient;
  char text[120];
  if (step.frame->front().factor.empty()) {
    std::snprintf(text, sizeof text, "a step of %.0f um near time = %.3g",
                  2e6 * std::hypot(by[0], by[1], by[2]), step.time);
  } else {
    std::snprintf(text, sizeof text, "a step under load of up to %.0f %s near time = %.3g",
                  1e6 * largest, step.frame->front().unit.starts_with("rad") ? "urad" : "um",
                  step.time);
  }
  return text;
}

StructureFinding finding_of(const BestStep& best, const std::vector<double>& sorted,
                            const Fit& fit) {
  StructureFinding finding;
  finding.variables = {"time"};
  finding.block = block_of(*best.frame, {step_at(best.time)});
  finding.score = best.score;
  finding.cost = best.score.delta_bic;
  finding.has_own_form = true;
  // For base and reflectors the translations, which come first; for joints half of each one's
  // largest deflection.
  std::vector<double> moved = best.score.coefficient;
  moved.resize(best.frame->front().factor.empty() ? 3 : best.frame->size());
  for (std::size_t i = 0; i < moved.size(); ++i) {
    const std::string& lever = (*best.frame)[i].factor;
    if (lever.empty()) continue;
    moved[i] *= largest_over_rows(fit.state(), lever);
    finding.joints.push_back((*best.frame)[i].on.front().index + 1);
  }
  const auto most = static_cast<std::size_t>(
      std::ranges::max_element(moved, {}, [](double a) { return std::abs(a); }) - moved.begin());
  const MovedCoordinate& first = (*best.frame)[most];
  // An equal displacement of all reflectors is one of the tool.
  const bool one_of_several = first.on.size() == 1 && fit.measurements().targets > 1;
  finding.coordinate = to_string(first.on.front(), one_of_several ? 2 : 1);
  finding.x = {sorted.front(), best.time, best.time, sorted.back()};
  finding.y = {-moved[most], -moved[most], moved[most], moved[most]};
  finding.shape = words_of_step(best, 2.0 * std::abs(moved[most]));
  return finding;
}

}  // namespace

bool payload_varies(const State& state) {
  if (!state.recorded("payload")) return false;
  const auto [low, high] = std::ranges::minmax(state.column("payload"));
  return high > low;
}

std::optional<StructureFinding> find_knock(const Scorer& scorer, const Fit& fit) {
  const State& state = fit.state();
  if (!state.recorded("time") || state.rows() < 2 * kLeastRows + 1) return std::nullopt;
  std::vector<double> sorted = state.column("time");
  std::ranges::sort(sorted);
  const std::vector<Frame> frames = frames_of(fit);
  const BestStep best = likeliest_step(scorer, frames, sorted);
  if (!best.frame || is_smooth_course(scorer, best, sorted)) return std::nullopt;
  const bool of_base = best.frame == &frames.front();
  if (of_base && std::ranges::count(long_pauses(state, sorted), best.time) > 0) return std::nullopt;
  return finding_of(best, sorted, fit);
}

std::optional<StructureFinding> find_new_set_up(const Scorer& scorer, const Fit& fit) {
  const State& state = fit.state();
  if (!state.recorded("time")) return std::nullopt;
  std::vector<double> sorted = state.column("time");
  std::ranges::sort(sorted);
  const std::vector<double> pauses = long_pauses(state, sorted);
  if (pauses.empty()) return std::nullopt;
  const Frame frame = base_frame();
  const BestStep best = best_of(scorer, frame, pauses);
  if (best.score.coefficient.empty()) return std::nullopt;
  StructureFinding finding = finding_of(best, sorted, fit);
  finding.tried = pauses.size();
  return finding;
}

}  // namespace armtrue
