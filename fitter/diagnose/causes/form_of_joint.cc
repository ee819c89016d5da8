// Causes outside the catalogue with a known form in one joint, which one of its effects resembles.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <numbers>

#include "fitter/diagnose/causes/causes.h"
#include "fitter/effects/effect.h"

namespace armtrue {
namespace {

// Periods tried, in cycles a turn of the joint: bearings and wave generators are softest in one
// direction, or across it.
constexpr int kMostCycles = 2;
// Largest change of a joint by one expression, at the largest load or temperature in the data or at
// 1 Nm or 1 K², whichever is larger [rad or m]. Ours: about as much as a gear's whole deflection on
// arms of 10 to 200 kg.
constexpr double kMostInAll = 1e-3;
constexpr int kPoints = 40;  // of a drawn function

// One joint's form: coefficients times expressions, and the variables it is told by.
struct Form {
  int joint = 0;
  std::vector<std::string> variables;
  std::vector<std::string> expressions;
  double largest = 0.0;  // of each expression in the data, without waves
  int cycles = 0;
};

Block block_of(const EffectContext& context, const Form& form, const std::string& unit) {
  Block block{{"custom", {}, {}}, {}, 1};
  for (const std::string& expression : form.expressions) {
    const std::string name = "structure_" + std::to_string(block.terms.parameters.size() + 1);
    block.terms.parameters.push_back(
        single_term("custom", {}, name, motor_unit(context, form.joint) + unit,
                    kMostInAll / std::max(form.largest, 1.0), motor(form.joint), expression));
  }
  return block;
}

// The form that explains most. Leaves its words to the caller. Nothing if none explains anything.
std::optional<std::pair<StructureFinding, Form>> likeliest(const Scorer& scorer, const Fit& fit,
                                                           const std::vector<Form>& forms,
                                                           const std::string& unit) {
  if (forms.empty()) return std::nullopt;
  std::vector<Block> blocks;
  for (const Form& form : forms) blocks.push_back(block_of(fit.context(), form, unit));
  const std::vector<BlockScore> scores = scorer.score(blocks, false);
  const auto best = static_cast<std::size_t>(
      std::ranges::min_element(scores, {}, &BlockScore::delta_bic) - scores.begin());
  if (scores[best].delta_bic >= 0.0) return std::nullopt;
  StructureFinding finding;
  finding.variables = forms[best].variables;
  finding.joints = {forms[best].joint};
  finding.coordinate = to_string(motor(forms[best].joint), 1);
  finding.block = std::move(blocks[best]);
  finding.score = scorer.score({finding.block}).front();
  finding.cost = finding.score.delta_bic;
  finding.has_own_form = true;
  finding.tried = forms.size();
  return std::pair{std::move(finding), forms[best]};
}

}  // namespace

std::optional<StructureFinding> find_uneven_spring(const Scorer& scorer, const Fit& fit) {
  const EffectContext& context = fit.context();
  if (!fit.state().computes_torque()) return std::nullopt;
  std::vector<Form> forms;
  for (const int joint : gravity_loaded_joints(context)) {
    if (context.robot().joints[static_cast<std::size_t>(joint - 1)].prismatic) continue;
    const std::string k = std::to_string(joint), torque = "tau" + k;
    for (int cycles = 1; cycles <= kMostCycles; ++cycles) {
      const std::string angle = (cycles == 1 ? "" : std::to_string(cycles) + "*") + "q" + k;
      forms.push_back({joint,
                       {torque, "q" + k},
                       {torque + "*sin(" + angle + ")", torque + "*cos(" + angle + ")"},
                       largest_of(context, torque),
                       cycles});
    }
  }
  auto found = likeliest(scorer, fit, forms, "/Nm");
  if (!found) return std::nullopt;
  auto& [finding, form] = *found;
  const std::vector<double>& wave = finding.score.coefficient;
  // The change of deflection over one turn of the joint at its largest load.
  for (int i = 0; i <= kPoints; ++i) {
    const double angle = std::numbers::pi * (2.0 * i / kPoints - 1.0);
    finding.x.push_back(angle);
    finding.y.push_back(form.largest * (wave[0] * std::sin(form.cycles * angle) +
                                        wave[1] * std::cos(form.cycles * angle)));
  }
  char text[160];
  std::snprintf(text, sizeof text,
                "a spring whose stiffness varies with the joint's angle: up to %.0f urad at the "
                "largest load, %s a turn",
                1e6 * form.largest * std::hypot(wave[0], wave[1]),
                form.cycles == 1 ? "once" : "twice");
  finding.shape = text;
  return std::move(finding);
}

std::optional<StructureFinding> find_curved_heat(const Scorer& scorer, const Fit& fit) {
  const EffectContext& context = fit.context();
  std::vector<Form> forms;
  for (const std::string& sensor : fit.state().sensors()) {
    const std::string change = "dT_" + sensor;
    const double largest = largest_of(context, change);
    if (!(largest > 0.0)) continue;
    for (int joint = 1; joint <= context.joint_count(); ++joint)
      forms.push_back({joint, {change}, {change + "^2"}, largest * largest, 0});
  }
  auto found = likeliest(scorer, fit, forms, "/K^2");
  if (!found) return std::nullopt;
  auto& [finding, form] = *found;
  const std::vector<double>& change = fit.state().column(form.variables.front());
  const auto [low, high] = std::ranges::minmax(change);
  for (int i = 0; i <= kPoints; ++i) {
    const double at = low + (high - low) * i / kPoints;
    finding.x.push_back(at);
    finding.y.push_back(finding.score.coefficient[0] * at * at);
  }
  char text[160];
  std::snprintf(
      text, sizeof text, "grows with the square of the temperature change: up to %.0f %s",
      1e6 * form.largest * std::abs(finding.score.coefficient[0]),
      context.robot().joints[static_cast<std::size_t>(form.joint - 1)].prismatic ? "um" : "urad");
  finding.shape = text;
  return std::move(finding);
}

}  // namespace armtrue
