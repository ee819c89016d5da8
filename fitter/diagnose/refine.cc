#include "fitter/diagnose/refine.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>

#include "fitter/solve/parallel.h"

namespace armtrue {
namespace {

using nlohmann::json;

// Where refits take long, Wald's approximation says whether a removal is worth one.
constexpr double kWorthTrying = 40.0;
constexpr double kBetterSwap = 1.0;
// Where another effect stands in for one exactly, nothing is gained by taking it out.
constexpr double kWorthRemoving = 2.0;
constexpr double kWorthRenaming = 10.0;
constexpr double kHardlyKnown = 0.1;  // of the physical bound
constexpr int kMostSwaps = 3;
constexpr int kPhysicalSteps = 3;

const std::set<std::string>& geometry() {
  static const std::set<std::string> names{"base_frame", "tool_offset", "joint_offset",
                                           "link_geometry"};
  return names;
}

// Effects of a model that may be tried for removal, joint by joint where they act joint by joint.
std::vector<EffectRequest> removable(const Fit& fit) {
  std::vector<EffectRequest> result;
  for (const EffectRequest& entry : fit.specification().effects) {
    if (geometry().contains(entry.effect) || entry.effect == "custom") continue;
    const Effect& effect = find_effect(entry.effect);
    EffectRequest whole = entry;
    if (whole.joints.empty()) whole.joints = effect.default_joints(fit.context());
    if (effect.joint_rule() != JointRule::kEach) {
      result.push_back(whole);
      continue;
    }
    for (const int joint : whole.joints) result.push_back({entry.effect, {joint}, entry.options});
  }
  return result;
}

// Rise of BIC if the effect's parameters went, by their joint Wald statistic.
double removal_cost(Fit& fit, const EffectRequest& request) {
  std::vector<int> unknowns;
  for (std::size_t i = 0; i < fit.model().parameters.size(); ++i) {
    const Parameter& p = fit.model().parameters[i];
    const bool same = p.effect == request.effect &&
                      (p.joints == request.joints || p.joints.empty() ||
                       find_effect(request.effect).joint_rule() != JointRule::kEach);
    if (same && fit.design().unknown_of(static_cast<int>(i)) >= 0)
      unknowns.push_back(fit.design().unknown_of(static_cast<int>(i)));
  }
  if (unknowns.empty()) return -1.0;
  const auto size = static_cast<Eigen::Index>(unknowns.size());
  Eigen::MatrixXd covariance(size, size);
  Eigen::VectorXd value(size);
  const std::vector<double> values = fit.design().unknown_values();
  for (Eigen::Index a = 0; a < size; ++a) {
    value[a] = values[static_cast<std::size_t>(unknowns[static_cast<std::size_t>(a)])];
    for (Eigen::Index b = 0; b < size; ++b) {
      covariance(a, b) = fit.covariance()(unknowns[static_cast<std::size_t>(a)],
                                          unknowns[static_cast<std::size_t>(b)]);
    }
  }
  const double n = static_cast<double>(fit.design().rows()) * fit.design().residuals_per_row();
  const double wald = value.dot(ScaledCholesky(covariance).solve(value));
  return n * std::log1p(wald / n) - static_cast<double>(size) * std::log(n);
}

ModelSpecification without_effects(const Fit& fit, const std::vector<EffectRequest>& requests) {
  ModelSpecification specification = fit.specification();
  for (const EffectRequest& request : requests)
    specification = without_effect(specification, request, fit.context());
  return specification;
}

// A trial of a model without one of its effects.
struct Removal {
  EffectRequest request;
  ModelSpecification rest;
  bool beside_table;         // put in beside a table, which may have its name now
  double strangeness;        // goes with it
  std::shared_ptr<Fit> fit;  // where the rest does well enough
};

// True where what was taken out goes on under another name: its coefficient was hardly known beside
// others, or `rest` has one that `fit` holds for the data's sake.
bool is_renamed(Fit& fit, const EffectRequest& gone, Fit& rest) {
  for (std::size_t i = 0; i < fit.model().parameters.size(); ++i) {
    const Parameter& p = fit.model().parameters[i];
    const int unknown = fit.design().unknown_of(static_cast<int>(i));
    if (p.effect != gone.effect || p.joints != gone.joints || p.bound <= 0.0 || unknown < 0)
      continue;
    if (std::sqrt(fit.covariance()(unknown, unknown)) > kHardlyKnown * p.bound) return true;
  }
  for (std::size_t i = 0; i < rest.model().parameters.size(); ++i) {
    const Parameter& p = rest.model().parameters[i];
    if (geometry().contains(p.effect) || rest.design().unknown_of(static_cast<int>(i)) < 0)
      continue;
    const int before = fit.model().index(p.name);
    if (before >= 0 && fit.design().unknown_of(before) < 0) return true;
  }
  return false;
}

std::set<std::string> labels_of(const std::vector<EffectRequest>& requests) {
  std::set<std::string> labels;
  for (const EffectRequest& request : requests) labels.insert(label(request));
  return labels;
}

// Takes out what no longer earns its keep. What stays is searched for anew: it may have settled
// beside what goes. What was in from the start is not asked for more because a table came beside
// it.
void prune(std::shared_ptr<Fit>& fit, const std::set<std::string>& from_the_start,
           const std::vector<EffectRequest>& keep, std::vector<EffectRequest>& removed) {
  const std::set<std::string> kept = labels_of(keep);
  for (bool again = true; again;) {
    again = false;
    const bool large = is_large(*fit);
    std::vector<Removal> removals;
    for (const EffectRequest& request : removable(*fit)) {
      const std::string name = label(request);
      if (kept.contains(name) || (large && removal_cost(*fit, request) > kWorthTrying)) continue;
      removals.push_back({request, without_effects(*fit, {request}),
                          is_beside_table(*fit, request) && !from_the_start.contains(name),
                          strangeness(*fit, request), nullptr});
    }
    const double bic = bayesian_information(*fit);
    in_parallel(removals.size(), [&](std::size_t k) {
      Removal& removal = removals[k];
      std::shared_ptr<Fit> rest = large ? refit(*fit, removal.rest, {}, HeldOut::kLater)
                                        : search(*fit, removal.rest, HeldOut::kLater);
      double allowed = removal.strangeness;
      if (removal.beside_table) {
        allowed += kBesideTable;
      } else {
        allowed -= kWorthRemoving;
        if (is_renamed(*fit, removal.request, *rest)) allowed -= kWorthRenaming;
      }
      if (bayesian_information(*rest) <= bic + allowed) removal.fit = rest;
    });
    const auto first = std::find_if(removals.begin(), removals.end(),
                                    [](const Removal& r) { return r.fit != nullptr; });
    if (first != removals.end()) {
      fit = first->fit;
      fit->cross_validate();
      removed.push_back(first->request);
      again = true;
    }
  }
}

DiagnoseOptions quick_options() {
  DiagnoseOptions quick;
  quick.look_ahead = false;
  quick.confirmed = 3;
  return quick;
}

// What is taken out together in a swap: each added effect, and all that were added on one joint.
std::vector<std::vector<EffectRequest>> swap_sets(const Fit& fit,
                                                  const std::set<std::string>& added) {
  std::vector<std::vector<EffectRequest>> sets;
  std::map<std::vector<int>, std::vector<EffectRequest>> by_joint;
  for (const EffectRequest& request : removable(fit)) {
    if (!added.contains(label(request))) continue;
    sets.push_back({request});
    if (request.joints.size() == 1) by_joint[request.joints].push_back(request);
  }
  for (const auto& [joint, requests] : by_joint) {
    if (requests.size() > 1) sets.push_back(requests);
  }
  return sets;
}

// What a model is judged by in a swap. It is the better one where it is so by what its effects
// explain: that it leaves the data less to say about geometry, which is always in, is no evidence
// for an effect.
struct Standing {
  double bic, without_geometry;

  explicit Standing(Fit& fit) : bic(bayesian_information(fit)), without_geometry(bic) {
    const double charge =
        std::log(static_cast<double>(fit.design().rows()) * fit.design().residuals_per_row());
    const std::vector<Parameter>& parameters = fit.model().parameters;
    for (std::size_t i = 0; i < parameters.size(); ++i) {
      if (geometry().contains(parameters[i].effect) &&
          fit.design().unknown_of(static_cast<int>(i)) >= 0)
        without_geometry -= charge;
    }
  }
  bool is_better_than(const Standing& other) const {
    return bic <= other.bic - kBetterSwap &&
           without_geometry <= other.without_geometry - kBetterSwap;
  }
};

// Tries each added effect for a swap: taken out, does the catalogue offer something better than
// putting it back?
bool swap(std::shared_ptr<Fit>& fit, const std::set<std::string>& added,
          std::vector<EffectRequest>& removed, Candidate& put_in) {
  const Standing present(*fit);
  const std::vector<std::vector<EffectRequest>> sets = swap_sets(*fit, added);
  std::vector<std::shared_ptr<Fit>> with(sets.size());
  std::vector<std::optional<Candidate>> better(sets.size());
  std::atomic<std::size_t> first = sets.size();
  in_parallel(sets.size(), [&](std::size_t k) {
    if (k > first) return;
    const std::unique_ptr<Fit> without = search(*fit, without_effects(*fit, sets[k]));
    const Diagnosis d = diagnose(*without, quick_options());
    const Candidate* best = d.recommended();
    if (!best || label(best->request) == label(sets[k].front())) return;
    if (bayesian_information(*without) + best->delta_bic > present.bic - kBetterSwap) return;
    with[k] = refit_with_smoothness_anew(
        *without, with_effect(without->specification(), best->request), best->starts);
    if (!Standing(*with[k]).is_better_than(present)) return;
    better[k] = *best;
    for (std::size_t before = first; k < before && !first.compare_exchange_weak(before, k);) {
    }
  });
  if (first == sets.size()) return false;
  const std::size_t k = first;
  put_in = *better[k];
  fit = with[k];
  removed.insert(removed.end(), sets[k].begin(), sets[k].end());
  return true;
}

// An effect that was put in, and the fit with it.
struct Put {
  Candidate candidate;
  std::shared_ptr<Fit> fit;
};

// A table may stand for several physical effects at once: a few of those, one after the other, are
// tried against it. Empty where they do no better.
std::vector<Put> physical_instead(const std::shared_ptr<Fit>& before,
                                  const std::shared_ptr<Fit>& with_table, Observer& observer) {
  DiagnoseOptions quick = quick_options();
  quick.generic = false;
  std::shared_ptr<Fit> current = before;
  const double goal = bayesian_information(*with_table);
  double last = bayesian_information(*before);
  std::vector<Put> steps;
  for (int step = 0; step < kPhysicalSteps; ++step) {
    const Diagnosis d = diagnose(*current, quick, observer);
    const Candidate* best = d.recommended();
    if (!best) break;
    current = refit_with_smoothness_anew(
        *current, with_effect(current->specification(), best->request), best->starts);
    steps.push_back({*best, current});
    const double now = bayesian_information(*current);
    if (now <= goal) return steps;
    // Each brings no more than the one before it.
    if ((last - now) * (kPhysicalSteps - 1 - step) < now - goal) break;
    last = now;
  }
  return {};
}

RefineStep make_step(const std::shared_ptr<Fit>& fit, Observer& observer) {
  RefineStep step;
  step.fit = fit;
  step.diagnosis = diagnose(*fit, {}, observer);
  return step;
}

// What a model with one more effect becomes: the effect, or physical ones in a table's place, less
// what they made needless.
struct Change {
  std::vector<Put> put;
  std::vector<EffectRequest> removed;
};

Change add(std::shared_ptr<Fit>& fit, const std::set<std::string>& from_the_start,
           const Candidate& candidate, Observer& observer) {
  Change change;
  const std::shared_ptr<Fit> before = fit;
  const ModelSpecification specification = with_effect(fit->specification(), candidate.request);
  fit = refit_with_smoothness_anew(*fit, specification, candidate.starts);
  if (find_effect(candidate.request.effect).generic())
    change.put = physical_instead(before, fit, observer);
  if (change.put.empty()) change.put = {{candidate, fit}};
  fit = change.put.back().fit;
  std::vector<EffectRequest> keep;
  const EffectRequest& last = change.put.back().candidate.request;
  if (change.put.size() == 1 && last.joints.size() < 2) keep.push_back(last);
  prune(fit, from_the_start, keep, change.removed);
  return change;
}

}  // namespace

json RefineStep::document() const {
  json result = diagnosis.to_json(*fit);
  result.erase("spectra");
  result["added"] = nullptr;
  if (added) {
    json parameters = json::array();
    for (std::size_t i = 0; i < added->parameters.size(); ++i) {
      parameters.push_back({{"name", added->parameters[i].name},
                            {"value", added->parameters[i].value},
                            {"sigma", added->sigma[i]},
                            {"unit", added->parameters[i].unit}});
    }
    result["added"] = {{"effect", added->request.effect},
                       {"joints", added->request.joints},
                       {"options", added->request.options},
                       {"parameters", parameters}};
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

ModelSpecification without_effect(const ModelSpecification& specification,
                                  const EffectRequest& request, const EffectContext& context) {
  ModelSpecification result = specification;
  for (auto entry = result.effects.begin(); entry != result.effects.end(); ++entry) {
    if (entry->effect != request.effect || entry->options != request.options) continue;
    const Effect& effect = find_effect(entry->effect);
    if (entry->joints.empty()) entry->joints = effect.default_joints(context);
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

std::vector<RefineStep> refine(std::shared_ptr<Fit> fit, const RefineOptions& options,
                               Observer& observer) {
  std::vector<RefineStep> steps;
  const auto show = [&](RefineStep step) {
    steps.push_back(std::move(step));
    if (options.on_step) options.on_step(steps.back());
  };
  // One step for each effect that came in; what went, went after the last.
  const auto finish = [&](const Change& change) {
    for (std::size_t k = 0; k + 1 < change.put.size(); ++k) {
      RefineStep step = make_step(change.put[k].fit, observer);
      step.added = change.put[k].candidate;
      show(std::move(step));
    }
    if (!change.removed.empty() && fit->smooth())
      fit = refit_with_smoothness_anew(*fit, fit->specification(), {});
    RefineStep step = make_step(fit, observer);
    if (!change.put.empty()) step.added = change.put.back().candidate;
    step.removed = change.removed;
    show(std::move(step));
  };
  finish({});
  const std::set<std::string> from_the_start = labels_of(removable(*fit));
  std::set<std::string> added;
  const auto note = [&](const Change& change) {
    for (const Put& put : change.put) {
      const EffectRequest& request = put.candidate.request;
      for (const int joint : request.joints)
        added.insert(label({request.effect, {joint}, request.options}));
      added.insert(label(request));
    }
    for (const EffectRequest& r : change.removed) added.erase(label(r));
  };
  int swaps = 0;
  for (int number = 0; number < options.most_steps; ++number) {
    if (const Candidate* best = steps.back().diagnosis.recommended()) {
      const Change change = add(fit, from_the_start, *best, observer);
      note(change);
      finish(change);
      continue;
    }
    // Nothing more to add. What is in was chosen while other things were missing: each is tried
    // against the catalogue again.
    Candidate put_in;
    std::vector<EffectRequest> removed;
    const bool large = is_large(*fit);
    if (large || added.size() < 2 || swaps++ >= kMostSwaps || !swap(fit, added, removed, put_in))
      break;
    Change change{{{put_in, fit}}, removed};
    prune(fit, from_the_start, {put_in.request}, change.removed);
    note(change);
    finish(change);
  }
  return steps;
}

}  // namespace armtrue
