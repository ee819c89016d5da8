#include <algorithm>
#include <cmath>
#include <cstdio>
#include <numbers>

#include "fitter/diagnose/structure.h"
#include "fitter/effects/effect.h"

namespace armtrue {
namespace {

// Periods tried, in cycles a turn of the joint: bearings and wave generators are softest in one
// direction, or across it.
constexpr int kMostCycles = 2;
// Largest change of a joint's deflection under its largest load [rad]. Ours: about as much as a
// gear's whole deflection on arms of 10 to 200 kg.
constexpr double kMostUneven = 1e-3;

// The joint's torque times sine and cosine of `cycles` times its angle.
Block uneven_block(const EffectContext& context, int joint, int cycles) {
  const std::string k = std::to_string(joint), torque = "tau" + k;
  const std::string angle = (cycles == 1 ? "" : std::to_string(cycles) + "*") + "q" + k;
  const double bound = softest(context, torque, kMostUneven, kMostUneven);
  Block block{{"custom", {}, {}}, {}, 1};
  for (const char* wave : {"sin", "cos"}) {
    block.terms.parameters.push_back(
        single_term("custom", {}, std::string("structure_uneven_") + wave, "rad/Nm", bound,
                    motor(joint), torque + "*" + wave + "(" + angle + ")"));
  }
  return block;
}

// The change of deflection over one turn of the joint at its largest load.
void draw_turn(StructureFinding& finding, int cycles, double load) {
  constexpr int kPoints = 40;
  for (int i = 0; i <= kPoints; ++i) {
    const double angle = std::numbers::pi * (2.0 * i / kPoints - 1.0);
    finding.x.push_back(angle);
    finding.y.push_back(load * (finding.score.coefficient[0] * std::sin(cycles * angle) +
                                finding.score.coefficient[1] * std::cos(cycles * angle)));
  }
}

}  // namespace

std::optional<StructureFinding> find_uneven_spring(const Scorer& scorer, const Fit& fit) {
  const EffectContext& context = fit.context();
  if (!fit.state().computes_torque()) return std::nullopt;
  std::vector<Block> blocks;
  std::vector<std::pair<int, int>> tried;  // joint, cycles
  for (const int joint : gravity_loaded_joints(context)) {
    if (context.robot().joints[static_cast<std::size_t>(joint - 1)].prismatic) continue;
    for (int cycles = 1; cycles <= kMostCycles; ++cycles) {
      blocks.push_back(uneven_block(context, joint, cycles));
      tried.emplace_back(joint, cycles);
    }
  }
  if (blocks.empty()) return std::nullopt;
  const std::vector<BlockScore> scores = scorer.score(blocks, false);
  const auto best = static_cast<std::size_t>(
      std::ranges::min_element(scores, {}, &BlockScore::delta_bic) - scores.begin());
  if (scores[best].delta_bic >= 0.0) return std::nullopt;
  const auto [joint, cycles] = tried[best];
  StructureFinding finding;
  finding.variables = {"tau" + std::to_string(joint), "q" + std::to_string(joint)};
  finding.joints = {joint};
  finding.coordinate = to_string(motor(joint), 1);
  finding.block = std::move(blocks[best]);
  finding.score = scorer.score({finding.block}).front();
  finding.cost = finding.score.delta_bic;
  finding.has_own_form = true;
  finding.tried = blocks.size();
  const double load = largest_of(context, finding.variables.front());
  draw_turn(finding, cycles, load);
  char text[160];
  std::snprintf(text, sizeof text,
                "a spring whose stiffness varies with the joint's angle: up to %.0f urad at the "
                "largest load, %s a turn",
                1e6 * load * std::hypot(finding.score.coefficient[0], finding.score.coefficient[1]),
                cycles == 1 ? "once" : "twice");
  finding.shape = text;
  return finding;
}

}  // namespace armtrue
