#include <algorithm>
#include <cstdio>

#include "fitter/diagnose/causes/causes.h"
#include "fitter/effects/effect.h"
#include "fitter/effects/tables.h"

namespace armtrue {
namespace {

// Numbers of nodes tried over the session: a swing needs about four of them.
constexpr std::size_t kNodesTried[] = {16, 32, 64};
// A node with fewer rows follows their noise.
constexpr std::size_t kRowsPerNode = 3;
// Slower courses of the base are found among all other smooth functions.
constexpr int kFewestCrossings = 4;
constexpr double kFurthestSwing = 1.5e-3;  // [m], half of what the effect `station` allows

Block block_over(const std::vector<double>& nodes, int axis) {
  Block block{{"custom", {}, {}}, {}, 1};
  for (std::size_t i = 0; i < nodes.size(); ++i) {
    block.terms.parameters.push_back(
        single_term("custom", {}, "structure_swings_" + std::to_string(i + 1), "m", kFurthestSwing,
                    on_base(axis), hat_expression("time", nodes, i)));
  }
  return block;
}

int crossings_of(const std::vector<double>& values) {
  double mean = 0.0;
  for (const double v : values) mean += v / static_cast<double>(values.size());
  int count = 0;
  for (std::size_t i = 1; i < values.size(); ++i)
    count += (values[i - 1] > mean) != (values[i] > mean) ? 1 : 0;
  return count;
}

}  // namespace

std::optional<StructureFinding> find_swings(const Scorer& scorer, const State& state) {
  if (!state.recorded("time")) return std::nullopt;
  std::vector<Block> blocks;
  std::vector<std::pair<std::vector<double>, int>> tried;  // nodes, axis
  for (const std::size_t count : kNodesTried) {
    if (count * kRowsPerNode > state.rows()) break;
    const std::vector<double> nodes = nodes_over(state.column("time"), 1e9, count);
    if (nodes.size() < count) return std::nullopt;  // all rows at one time
    for (int axis = 0; axis < 3; ++axis) {
      blocks.push_back(block_over(nodes, axis));
      tried.emplace_back(nodes, axis);
    }
  }
  if (blocks.empty()) return std::nullopt;
  const std::vector<BlockScore> scores = scorer.score(blocks, false);
  const auto best = static_cast<std::size_t>(
      std::ranges::min_element(scores, {}, &BlockScore::delta_bic) - scores.begin());
  const auto& [nodes, axis] = tried[best];
  StructureFinding finding;
  finding.variables = {"time"};
  finding.coordinate = to_string(on_base(axis), 1);
  finding.block = std::move(blocks[best]);
  finding.score = scorer.score({finding.block}).front();
  finding.cost = finding.score.delta_bic;
  finding.nodes = nodes.size();
  finding.x = nodes;
  finding.y = finding.score.coefficient;
  const int crossings = crossings_of(finding.y);
  if (finding.cost >= 0.0 || crossings < kFewestCrossings) return std::nullopt;
  const auto [low, high] = std::ranges::minmax_element(finding.y);
  char text[96];
  std::snprintf(text, sizeof text, "about %d swings of up to %.0f um over the session",
                (crossings + 1) / 2, 1e6 * (*high - *low));
  finding.shape = text;
  return finding;
}

}  // namespace armtrue
