#include <algorithm>
#include <cmath>
#include <cstdio>

#include "fitter/diagnose/structure.h"
#include "fitter/effects/effect.h"

namespace armtrue {
namespace {

// Times tried over all rows, and then again and again around the best of them.
constexpr int kTimesTried = 30, kTimesAround = 16;
// With fewer rows before or after it, a step is some gross errors.
constexpr std::size_t kLeastRows = 12;
// As far as a tracker is believed to have been moved: what the effect `station` allows, by half
// since a step goes from minus to plus.
constexpr double kFurthest = 1.5e-3, kLargest = 1e-3;  // [m], [rad]

// The arm's base displaced in all directions, from minus to plus, at one time.
Block step_block(double time) {
  Block block{{"custom", {}, {}}, {}, 1};
  const std::string basis = "sign(time - " + Expression::number(time).to_string() + ")";
  for (int c = 0; c < 6; ++c) {
    block.terms.parameters.push_back(
        single_term("custom", {}, std::string("structure_base_") + kComponentNames[c],
                    c < 3 ? "m" : "rad", c < 3 ? kFurthest : kLargest, on_base(c), basis));
  }
  return block;
}

// Times halfway between neighbours, `count` of them evenly over rows `low` to `high` in time's
// order.
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

struct BestStep {
  double time = 0.0;
  BlockScore score;
};

BestStep best_of(const Scorer& scorer, const std::vector<double>& times) {
  std::vector<Block> blocks;
  for (const double time : times) blocks.push_back(step_block(time));
  const std::vector<BlockScore> scores = scorer.score(blocks, false);
  BestStep best;
  for (std::size_t i = 0; i < scores.size(); ++i) {
    if (scores[i].gain > best.score.gain) best = {times[i], scores[i]};
  }
  return best;
}

}  // namespace

std::optional<StructureFinding> find_knock(const Scorer& scorer, const State& state) {
  if (!state.recorded("time") || state.rows() < 2 * kLeastRows + 1) return std::nullopt;
  std::vector<double> sorted = state.column("time");
  std::ranges::sort(sorted);
  const std::size_t first = kLeastRows, last = sorted.size() - kLeastRows;
  BestStep best = best_of(scorer, times_between(sorted, first, last, kTimesTried));
  if (best.score.delta_bic >= 0.0) return std::nullopt;
  // `cell`: rows between neighbouring times of the last round.
  for (std::size_t cell = (last - first) / kTimesTried; cell > 0; cell = 2 * cell / kTimesAround) {
    const auto place =
        static_cast<std::size_t>(std::ranges::upper_bound(sorted, best.time) - sorted.begin());
    BestStep around = best_of(scorer, times_between(sorted, std::max(first + cell, place) - cell,
                                                    std::min(last, place + cell), kTimesAround));
    if (around.score.gain > best.score.gain) best = std::move(around);
  }

  StructureFinding finding;
  finding.variables = {"time"};
  finding.block = step_block(best.time);
  finding.score = best.score;
  finding.cost = best.score.delta_bic;
  finding.has_own_form = true;
  const auto& moved = best.score.coefficient;
  const auto most = static_cast<std::size_t>(
      std::max_element(moved.begin(), moved.begin() + 3,
                       [](double a, double b) { return std::abs(a) < std::abs(b); }) -
      moved.begin());
  finding.coordinate = to_string(on_base(static_cast<int>(most)), 1);
  finding.x = {sorted.front(), best.time, best.time, sorted.back()};
  finding.y = {-moved[most], -moved[most], moved[most], moved[most]};
  char text[96];
  std::snprintf(text, sizeof text, "a step of %.0f um near time = %.3g",
                2e6 * std::hypot(moved[0], moved[1], moved[2]), best.time);
  finding.shape = text;
  return finding;
}

}  // namespace armtrue
