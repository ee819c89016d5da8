#include "fitter/diagnose/refine.h"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <set>

namespace armtrue {
namespace {

using nlohmann::json;

// The same effect on several joints comes in at once where each is this probable: tables, since
// each waits for the others to see what it explains; any effect where one refit takes long.
constexpr double kSurely = 0.9;
// What is superfluous can go without poses that were not fitted being predicted worse than by this
// share.
constexpr double kSameWithout = 1e-2;
constexpr std::size_t kLargeModel = 200;  // parameters
// Held-out errors of two models that agree by this share are equal.
constexpr double kSameError = 1e-3;

json parameters_json(const Candidate& c) {
  json parameters = json::array();
  for (std::size_t i = 0; i < c.parameters.size(); ++i) {
    parameters.push_back({{"name", c.parameters[i].name},
                          {"value", c.parameters[i].value},
                          {"sigma", c.sigma[i]},
                          {"unit", c.parameters[i].unit}});
  }
  return parameters;
}

// A change of the model: what comes in, what goes.
struct Move {
  std::optional<Candidate> added;
  std::vector<EffectRequest> removed;

  std::string name() const {
    std::string text = added ? "+" + label(added->request) : "";
    for (const EffectRequest& r : removed) text += "-" + label(r);
    return text;
  }
};

Candidate with_its_like(const Diagnosis& d, const Candidate& best, bool is_large) {
  Candidate wide = best;
  const Effect& effect = find_effect(best.request.effect);
  if (effect.joint_rule() != JointRule::kEach && effect.joint_rule() != JointRule::kPair)
    return wide;
  if (!effect.generic() && !is_large) return wide;
  for (const Candidate& c : d.candidates) {
    if (&c == &best || c.request.effect != best.request.effect || c.probability < kSurely ||
        c.request.joints.size() != best.request.joints.size() ||
        c.request.options != best.request.options || c.request.joints == best.request.joints)
      continue;
    wide.request.joints.insert(wide.request.joints.end(), c.request.joints.begin(),
                               c.request.joints.end());
    wide.parameters.insert(wide.parameters.end(), c.parameters.begin(), c.parameters.end());
    wide.sigma.insert(wide.sigma.end(), c.sigma.begin(), c.sigma.end());
  }
  if (effect.joint_rule() == JointRule::kEach)
    std::sort(wide.request.joints.begin(), wide.request.joints.end());
  return wide;
}

// What the diagnosis asks for: the most probable effect in, or the least probable out. `refused`:
// moves tried before.
std::optional<Move> next_move(const Diagnosis& d, const std::set<std::string>& refused,
                              bool is_large) {
  const Candidate* best = d.recommended();
  if (best) {
    Move move{with_its_like(d, *best, is_large), {}};
    if (!refused.contains(move.name())) return move;
    for (const Candidate& c : d.candidates) {
      Move other{c, {}};
      if (c.probability > 0.5 && !refused.contains(other.name())) return other;
    }
  }
  for (const Superfluous& s : d.superfluous) {
    Move move{std::nullopt, {s.request}};
    if (!refused.contains(move.name())) return move;
  }
  return std::nullopt;
}

ModelSpecification apply(const Fit& fit, const Move& move) {
  ModelSpecification specification = fit.specification();
  for (const EffectRequest& r : move.removed)
    specification = without_effect(specification, r, fit.context());
  return move.added ? with_effect(specification, move.added->request) : specification;
}

// Held-out errors at random, in time and by region: a model is worse where their mean is.
double held_out(const Fit& fit) {
  double sum = 0.0;
  for (const ErrorSummary& error : fit.held_out_errors()) sum += std::log(error.mean);
  return sum / static_cast<double>(fit.held_out_errors().size());
}

RefineStep make_step(const std::shared_ptr<Fit>& fit, Move move,
                     const std::set<std::string>& searched, Observer& observer) {
  RefineStep step;
  step.fit = fit;
  step.added = std::move(move.added);
  step.removed = std::move(move.removed);
  DiagnoseOptions diagnose_options;
  diagnose_options.searched = searched;
  step.diagnosis = diagnose(*fit, diagnose_options, observer);
  return step;
}

}  // namespace

json RefineStep::document() const {
  json result = diagnosis.to_json(*fit);
  result.erase("spectra");
  result["added"] = nullptr;
  if (added) {
    result["added"] = {{"effect", added->request.effect},
                       {"joints", added->request.joints},
                       {"options", added->request.options},
                       {"parameters", parameters_json(*added)}};
  }
  result["removed"] = json::array();
  for (const EffectRequest& r : removed) {
    result["removed"].push_back({{"effect", r.effect},
                                 {"joints", r.joints},
                                 {"options", r.options},
                                 {"parameters", json::array()}});
  }
  result["effects"] = fit->specification().to_json()["effects"];
  return result;
}

std::vector<RefineStep> refine(std::shared_ptr<Fit> fit, const RefineOptions& options,
                               Observer& observer) {
  std::vector<RefineStep> steps;
  std::set<std::string> refused;
  const auto show = [&](RefineStep step) {
    steps.push_back(std::move(step));
    if (options.on_step) options.on_step(steps.back());
  };
  show(make_step(fit, {}, {}, observer));
  const std::vector<EffectRequest> initial = removable_effects(*fit);
  const auto searched = [&] {
    std::set<std::string> labels;
    for (const EffectRequest& request : removable_effects(*fit)) labels.insert(label(request));
    for (const EffectRequest& request : initial) labels.erase(label(request));
    return labels;
  };
  while (static_cast<int>(steps.size()) <= options.most_steps) {
    const std::optional<Move> move =
        next_move(steps.back().diagnosis, refused, fit->model().parameters.size() > kLargeModel);
    if (!move) break;
    refused.insert(move->name());  // no move twice: a search that returns would never end
    std::shared_ptr<Fit> changed;
    try {
      changed = refit(*fit, apply(*fit, *move),
                      move->added ? move->added->starts : std::map<std::string, double>{});
    } catch (const ModelError&) {
      continue;
    }
    if (held_out(*changed) > held_out(*fit) + (move->added ? kSameError : kSameWithout)) continue;
    fit = changed;
    show(make_step(fit, *move, searched(), observer));
  }
  return steps;
}

}  // namespace armtrue
