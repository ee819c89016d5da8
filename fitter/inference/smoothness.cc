#include "fitter/inference/smoothness.h"

#include <algorithm>
#include <array>
#include <set>

#include "fitter/inference/table_evidence.h"

namespace armtrue {
namespace {

constexpr int kPasses = 2;
constexpr std::array<double, 6> kFactors{0.03, 0.1, 0.3, 3.0, 10.0, 30.0};

const std::string& effect_of(const Model& model, const Penalty& penalty) {
  const auto at = static_cast<std::size_t>(model.index(penalty.row.front().first));
  return model.parameters[at].effect;
}

}  // namespace

bool has_tables(const Model& model) {
  return std::any_of(model.penalties.begin(), model.penalties.end(),
                     [](const Penalty& p) { return p.smoothness; });
}

void scale_smoothness(Model& model, const std::string& effect, double factor) {
  for (Penalty& penalty : model.penalties) {
    if (penalty.smoothness && effect_of(model, penalty) == effect) penalty.sigma *= factor;
  }
}

Smoothness choose_smoothness(Design& design, Model& model, const Smoothness& present) {
  const NormalEquations data = accumulate(design);
  const auto [sigma, evidence] = likeliest_smoothness(design, data, smoothnesses());
  Smoothness chosen{sigma, design.measurements().typical_sigma, present.scale};
  std::set<std::string> effects;
  for (const Penalty& penalty : model.penalties) {
    if (penalty.smoothness) effects.insert(effect_of(model, penalty));
  }
  double least = evidence;
  for (int pass = 0; effects.size() > 1 && pass < kPasses; ++pass) {
    for (const std::string& effect : effects) {
      double best = 1.0;
      for (const double factor : kFactors) {
        scale_smoothness(model, effect, factor);
        const double now = likeliest_smoothness(design, data, {sigma}).evidence;
        scale_smoothness(model, effect, 1.0 / factor);
        if (now >= least) continue;
        least = now;
        best = factor;
      }
      scale_smoothness(model, effect, best);
      chosen.scale.try_emplace(effect, 1.0).first->second *= best;
    }
  }
  return chosen;
}

}  // namespace armtrue
