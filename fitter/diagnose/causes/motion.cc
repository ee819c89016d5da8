#include <algorithm>
#include <cstdio>

#include "fitter/diagnose/causes/causes.h"
#include "fitter/effects/effect.h"

namespace armtrue {
namespace {

// In a short file a joint reaches its large angles upwards and its small ones downwards, so that
// direction can hardly be distinguished from angle.
constexpr std::size_t kFewestRows = 40;
constexpr double kMostLost = 1e-3;  // [rad or m], as the lost motion of a gear

}  // namespace

std::optional<StructureFinding> find_motion(const Scorer& scorer, const State& state) {
  if (state.rows() < kFewestRows) return std::nullopt;
  std::vector<Block> blocks;
  std::vector<int> joints;
  for (int k = 1; k <= state.robot().joint_count(); ++k) {
    if (state.robot().is_passive(k) || state.recorded("dir" + std::to_string(k))) continue;
    Block block{{"custom", {}, {}}, {}, 1};
    block.terms.parameters.push_back(single_term("custom", {}, "structure_motion", "", kMostLost,
                                                 motor(k), State::motion_of(k)));
    blocks.push_back(std::move(block));
    joints.push_back(k);
  }
  if (blocks.empty()) return std::nullopt;
  const std::vector<BlockScore> scores = scorer.score(blocks, false);
  const auto best = static_cast<std::size_t>(
      std::ranges::min_element(scores, {}, &BlockScore::delta_bic) - scores.begin());
  if (scores[best].delta_bic >= 0.0) return std::nullopt;
  const int joint = joints[best];
  StructureFinding finding;
  finding.variables = {"dir" + std::to_string(joint)};
  finding.joints = {joint};
  finding.coordinate = to_string(motor(joint), 1);
  finding.block = std::move(blocks[best]);
  finding.score = scores[best];
  finding.cost = scores[best].delta_bic;
  finding.has_own_form = true;
  const double side = scores[best].coefficient.front();
  finding.x = {-1.0, 1.0};
  finding.y = {-side, side};
  char text[96];
  std::snprintf(text, sizeof text, "%.0f urad between motions up and down from row to row",
                2e6 * std::abs(side));
  finding.shape = text;
  return finding;
}

}  // namespace armtrue
