#include "fitter/evidence/refit.h"

#include <algorithm>

#include "fitter/evidence/block.h"
#include "fitter/evidence/words.h"

namespace armtrue {

std::string label(const EffectRequest& request) {
  std::string text = request.effect;
  for (std::size_t i = 0; i < request.joints.size(); ++i)
    text += (i ? "," : " ") + std::to_string(request.joints[i]);
  for (const std::string& key : find_effect(request.effect).told_apart_by()) {
    if (request.options.contains(key)) text += " " + key + " " + list_words(request.options[key]);
  }
  return text;
}

ModelSpecification with_effect(const ModelSpecification& specification,
                               const EffectRequest& request) {
  ModelSpecification result = specification;
  const EffectRequest added = as_added(request);
  for (EffectRequest& entry : result.effects) {
    const bool each = find_effect(entry.effect).joint_rule() == JointRule::kEach;
    if (!each || entry.effect != added.effect || entry.joints.empty() ||
        entry.options != added.options)
      continue;
    entry.joints.insert(entry.joints.end(), added.joints.begin(), added.joints.end());
    std::sort(entry.joints.begin(), entry.joints.end());
    return result;
  }
  result.effects.push_back(added);
  return result;
}

ModelSpecification without_effect(const ModelSpecification& specification,
                                  const EffectRequest& request, const EffectContext& context) {
  ModelSpecification result = specification;
  for (auto entry = result.effects.begin(); entry != result.effects.end(); ++entry) {
    if (entry->effect != request.effect || entry->options != request.options) continue;
    const Effect& effect = find_effect(entry->effect);
    if (entry->joints.empty()) entry->joints = effect.joints_of_bare_entry(context);
    if (effect.joint_rule() != JointRule::kEach) {
      if (entry->joints != request.joints) continue;
      result.effects.erase(entry);
      return result;
    }
    std::erase_if(entry->joints, [&](int k) {
      return std::find(request.joints.begin(), request.joints.end(), k) != request.joints.end();
    });
    if (entry->joints.empty()) {
      result.effects.erase(entry);
      return result;
    }
  }
  return result;
}

std::unique_ptr<Fit> refit(const Fit& fit, const ModelSpecification& specification,
                           const std::map<std::string, double>& guesses, bool keeps_weights) {
  FitOptions options = fit.options();
  options.keeps_weights = keeps_weights;
  options.nonlinear_guesses = guesses;
  options.nonlinear_starts.clear();
  for (const NonlinearParameter& p : fit.model().nonlinear) {
    if (!guesses.contains(p.name)) options.nonlinear_starts.try_emplace(p.name, p.value);
  }
  // The values that the search found are accurate enough for steps between two full fits.
  if (keeps_weights) options.nonlinear_starts.insert(guesses.begin(), guesses.end());
  auto start = std::make_shared<StartPoint>(fit.start_point());
  start->values.insert(guesses.begin(), guesses.end());
  options.start = std::move(start);
  return Fit::run(fit.robot(), fit.state().columns(), specification, options);
}

}  // namespace armtrue
