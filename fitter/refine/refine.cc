#include "fitter/refine/refine.h"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <set>

#include "fitter/common/parallel.h"
#include "fitter/inference/smoothness.h"
#include "fitter/model/variable.h"
#include "fitter/refine/growth.h"
#include "fitter/refine/moves.h"

namespace armtrue {
namespace {

// When an effect is removed or exchanged, held-out errors may grow by no more than this share, and
// by no more than chance explains, in standard errors.
constexpr double kSameWithout = 1e-2;
constexpr double kByChance = 2.0;
// Finer tables take memory in the compensator. They are kept only if the error on poses held out at
// random falls by this share, and the mean over poses held out at random, in time and by region
// grows by no more than chance explains.
constexpr double kWorthNodes = 1e-2;
// At most this many candidates are fitted to explain a structure without a name: those that explain
// in the search, which is linear, at least kMightExplain of what the structure's smooth function
// explains.
constexpr std::size_t kFittedForStructure = 6;
constexpr double kMightExplain = 0.3;
// At most this many of them are followed by a search beside them, which takes as long as all
// searches before: those that explain, once fitted, at least kExplainsStructure of what the
// function explains.
constexpr int kTriedForStructure = 3;
constexpr double kExplainsStructure = 0.8;
// Candidates of one search from which moves are taken.
constexpr std::size_t kLookedThrough = 60;
// Held-out errors of two models that agree within this share are equal.
constexpr double kSameError = 1e-3;
// Two fits of one model are equal if their noise agrees within this share: a diagnosis of the other
// then rounds to the same probabilities.
constexpr double kSettledNoise = 1e-5;
constexpr int kSettlingPasses = 3;

// Whether an effect is a function of time.
bool runs_with_time(const EffectContext& context, const EffectRequest& request) {
  const EffectTerms effect = build_effect(context, request);
  return std::ranges::any_of(effect.parameters, [&](const Parameter& p) {
    return std::ranges::any_of(p.terms, [&](const Term& term) {
      return std::ranges::any_of(term.basis.variables(), [&](const std::string& name) {
        const auto variable = parse_variable(name, context.joint_count());
        return variable && variable->kind == VariableKind::kTime;
      });
    });
  });
}

bool runs_with_time(const EffectContext& context, const Move& move) {
  const auto does = [&](const EffectRequest& r) { return runs_with_time(context, r); };
  return (move.added && does(move.added->request)) || std::ranges::any_of(move.removed, does);
}

// The search's diagnosis, for the model with one of its sure effects added: its probabilities are
// averages over models that nearly all have that effect.
Diagnosis with_added(const Diagnosis& searched, const Candidate& added, Fit& fit) {
  Diagnosis d = searched;
  const EffectContext& context = fit.context();
  const std::vector<int>& joints = added.request.joints;
  for (const EffectRequest& part : parts_of(context, as_added(added.request)))
    d.probability_present[label(part)] = added.in_any_form;
  std::erase_if(d.candidates, [&](const Candidate& c) {
    const bool of_a_joint = find_effect(c.request.effect).joint_rule() == JointRule::kEach;
    // Another form of it waits for the next search. A table of several joints adds all of them.
    return label(c.request) == label(added.request) ||
           (of_a_joint && c.request.effect == added.request.effect &&
            c.request.options == added.request.options &&
            std::ranges::all_of(c.request.joints, [&](int k) {
              return std::ranges::find(joints, k) != joints.end();
            }));
  });
  d.nothing_searched = 1.0;
  for (Candidate& c : d.candidates) {
    c.recommend = false;
    if (!c.spanned) d.nothing_searched = std::min(d.nothing_searched, 1.0 - c.in_any_form);
  }
  const auto next = std::ranges::find_if(d.candidates, is_sure);
  if (next != d.candidates.end()) next->recommend = true;
  conclude(d, fit, linearize(fit));
  return d;
}

// Probability that an added effect or one of its alternatives is present: they share it.
double probability_of_set(const Diagnosis& d, const Candidate& added) {
  std::vector<std::string> set = added.confounded_with;
  set.push_back(label(added.request));
  double sum = 0.0;
  for (const std::string& name : set) {
    if (const auto there = d.probability_present.find(name); there != d.probability_present.end())
      sum += there->second;
  }
  for (const Candidate& c : d.candidates) {
    if (names(added, c) || label(c.request) == set.back()) sum += c.probability;
  }
  return sum;
}

// True if none of an added effect's parameters is identifiable beside the fitted ones.
bool adds_nothing(const Fit& fit, const Candidate& added) {
  const auto& held = fit.identifiability().held;
  return std::ranges::all_of(added.parameters, [&](const Parameter& p) {
    return std::ranges::find(held, fit.model().index(p.name), &Unidentifiable::parameter) !=
           held.end();
  });
}

std::vector<EffectRequest> believed_effects(const Fit& fit, const std::set<std::string>& searched) {
  std::vector<EffectRequest> effects = removable_effects(fit);
  std::erase_if(effects,
                [&](const EffectRequest& request) { return searched.contains(label(request)); });
  return effects;
}

// The fit that `run` returns; null if the model cannot be fitted.
template <typename Run>
std::shared_ptr<Fit> fit_or_none(const Run& run) {
  try {
    return run();
  } catch (const ModelError&) {
    return nullptr;
  }
}

class Refinement {
 public:
  Refinement(std::shared_ptr<Fit> fit, const RefineOptions& options, Observer& observer)
      : Refinement(fit, options, observer, believed_effects(*fit, options.searched)) {}

  std::vector<RefineStep> run() {
    search();
    if (!explain_structure() && !explain_without_superfluous()) refine_tables();
    for (int pass = 0; pass < kSettlingPasses && !settle(); ++pass) search();
    show();
    return std::move(steps_);
  }

 private:
  // `believed`: effects of the fit that no search added.
  Refinement(std::shared_ptr<Fit> fit, const RefineOptions& options, Observer& observer,
             std::vector<EffectRequest> believed)
      : options_(options), observer_(observer), initial_(std::move(believed)) {
    steps_.push_back({std::nullopt, {}, diagnose_now(*fit), fit});
    taken_.insert(fit->specification().to_json().dump());
  }

  // Repeats rounds until one changes nothing and all that it recommends was fitted and refused.
  void search() {
    do {
      for (auto full = steps_.back().fit; one_round(); full = steps_.back().fit) {
        fit_in_full(*full);
        refused_.clear();
        left_out_.clear();
        steps_.back().diagnosis = diagnose_now(*steps_.back().fit);
        is_diagnosed_ = true;
      }
    } while (leave_out());
  }

  Diagnosis diagnose_now(Fit& fit) const;
  // A move's model and its fit, which is null if the model cannot be fitted.
  struct Trial {
    std::size_t move = 0;  // index in the search's moves
    ModelSpecification specification;
    std::map<std::string, double> starts;  // of new parameters
    std::shared_ptr<Fit> fit;
  };
  Trial trial_of(const Move& move, std::size_t number, const Trial* on_top_of) const;
  bool one_round();
  bool explain_structure();
  bool explain_without_superfluous();
  std::vector<Trial> next_trials(const std::vector<Move>& moves, std::size_t& next) const;
  void refine_tables();
  void fit_trials(std::vector<Trial>& trials, bool keeps_weights = false) const;
  void fit_in_full(const Fit& full);
  bool accept(const Move& move, const Trial& trial);
  bool leave_out();
  bool is_full() const { return static_cast<int>(steps_.size()) > options_.most_steps; }
  bool stands(const Trial& trial) const;
  std::shared_ptr<Fit> from_the_beginning(const Fit& step,
                                          const ModelSpecification& specification) const;
  bool settle();
  void show() {
    if (options_.on_step) options_.on_step(steps_.back());
  }

  const RefineOptions& options_;
  Observer& observer_;
  std::vector<EffectRequest> initial_;
  std::vector<RefineStep> steps_;
  bool removes_beside_structure_ = false;  // no candidate explained it
  bool is_diagnosed_ = true;               // the last step, by a search for its own fit
  std::shared_ptr<Fit> settled_;           // the last fit that was solved from the beginning
  std::set<std::string> taken_;            // models of all steps so far; none is taken twice
  std::set<std::string> refused_;          // models tried since the last search and not taken
  std::set<std::string> left_out_;  // keys (key_of) of what the last step recommended in vain
  std::set<std::string> gone_;      // effects that were removed: one that gains about as much as it
                                    // costs would enter and leave with every other change
};

Diagnosis Refinement::diagnose_now(Fit& fit) const {
  DiagnoseOptions options;
  options.listed = kLookedThrough;
  options.left_out = left_out_;
  for (const EffectRequest& request : removable_effects(fit))
    options.searched.insert(label(request));
  for (const EffectRequest& request : initial_) options.searched.erase(label(request));
  Diagnosis d = diagnose(fit, options, observer_);
  // Effects of the initial model are their owner's statement and get no probability.
  std::erase_if(d.probability_present,
                [&](const auto& entry) { return !options.searched.contains(entry.first); });
  // Effects that no search removes (joint zeros) keep the probability with which they were added.
  if (!steps_.empty()) {
    for (const EffectRequest& entry : fit.specification().effects) {
      for (const EffectRequest& part : parts_of(fit.context(), entry)) {
        const auto& before = steps_.back().diagnosis.probability_present;
        if (const auto known = before.find(label(part)); known != before.end())
          d.probability_present.insert(*known);
      }
    }
  }
  return d;
}

// Fits all trials in parallel, each from the last step's fit.
void Refinement::fit_trials(std::vector<Trial>& trials, bool keeps_weights) const {
  const Fit& fit = *steps_.back().fit;
  in_parallel(trials.size(), [&](std::size_t i) {
    Trial& trial = trials[i];
    trial.fit =
        fit_or_none([&] { return refit(fit, trial.specification, trial.starts, keeps_weights); });
  });
}

// Fits a step's model from the beginning, as every reader of its file will. The smoothness of
// tables and the weight of orientations depend on the starting point, and a step's fit starts at
// the step before.
std::shared_ptr<Fit> Refinement::from_the_beginning(const Fit& step,
                                                    const ModelSpecification& specification) const {
  FitOptions options = step.options();
  options.nonlinear_starts.clear();
  options.nonlinear_guesses.clear();
  return Fit::run(step.robot(), step.state().columns(), specification, options);
}

// Replaces the last step's fit by one from the beginning. Returns false if a search with the new
// fit recommends an effect.
bool Refinement::settle() {
  RefineStep& last = steps_.back();
  const Fit& before = *last.fit;
  if (steps_.size() == 1 || !(has_tables(before.model()) || before.measurements().has_rotation()))
    return true;
  if (last.fit != settled_) {
    std::shared_ptr<Fit> anew = from_the_beginning(before, before.specification());
    const double noise = anew->measurements().typical_sigma / before.measurements().typical_sigma;
    const double turns =
        before.measurements().has_rotation()
            ? anew->measurements().sigma_rotation / before.measurements().sigma_rotation
            : 1.0;
    is_diagnosed_ = is_diagnosed_ && anew->smoothness_sigma() == before.smoothness_sigma() &&
                    std::abs(noise - 1.0) < kSettledNoise && std::abs(turns - 1.0) < kSettledNoise;
    settled_ = last.fit = std::move(anew);
  }
  if (is_diagnosed_) return true;
  last.diagnosis = diagnose_now(*last.fit);
  is_diagnosed_ = true;
  return !last.diagnosis.recommended();
}

// The effects of one search are added with the gross errors and smoothness of the last full fit;
// these are determined anew before the next search. Nonlinear parameters that `full`, the last full
// fit, did not have are searched for from all their starts: until now they have only descended from
// the values of a candidate, and may have ended in a local minimum.
void Refinement::fit_in_full(const Fit& full) {
  RefineStep& last = steps_.back();
  if (!last.fit->kept_weights()) return;
  std::map<std::string, double> guesses;
  for (const NonlinearParameter& p : last.fit->model().nonlinear) guesses.emplace(p.name, p.value);
  for (const NonlinearParameter& p : full.model().nonlinear) guesses.erase(p.name);
  last.fit = refit(*last.fit, last.fit->specification(), guesses);
}

// Whether a search with the trial's model recommends nothing. If an earlier search with that model
// added an effect (with another linearisation or other candidates), the two would repeat in a loop.
bool Refinement::stands(const Trial& trial) const {
  const std::unique_ptr<Fit> full = refit(*trial.fit, trial.specification);
  return !diagnose_now(*full).recommended();
}

// Whether a trial becomes the next step. It is refused if it cannot be fitted, adds nothing or
// predicts held-out poses worse. If the added effect is sure, or one is removed or exchanged, their
// error may grow by as much as chance explains. If the search is not sure of the added effect, it
// must fall by more than that: true effects of 50 to 90 % lowered it by 7 % and more, false ones by
// about 1 % (noise_x4 and sixty_poses from seed 33940).
bool Refinement::accept(const Move& move, const Trial& trial) {
  const std::string model = trial.specification.to_json().dump();
  refused_.insert(model);
  const Fit& fit = *steps_.back().fit;
  if (!trial.fit || (move.added && adds_nothing(*trial.fit, *move.added))) return false;
  const Growth growth = held_out_growth(fit, *trial.fit, !runs_with_time(fit.context(), move));
  const double worse = !move.removed.empty()
                           ? std::clamp(kByChance * growth.sigma, kSameError, kSameWithout)
                       : move.sure ? kSameError + growth.sigma
                                   : -kByChance * growth.sigma;
  if (growth.mean > worse || (taken_.contains(model) && !stands(trial))) return false;
  show();
  taken_.insert(model);
  for (const EffectRequest& r : move.removed) gone_.insert(label(r));
  const Diagnosis& before = steps_.back().diagnosis;
  Diagnosis now = move.added ? with_added(before, *move.added, *trial.fit) : before;
  steps_.push_back({move.added, move.removed, std::move(now), trial.fit});
  return true;
}

// If the last diagnosis still recommends a candidate, that one was fitted and refused: the next
// candidate is recommended instead or, if there is none, the verdict is found anew. Returns false
// if nothing was recommended, or no step was left to fit it.
bool Refinement::leave_out() {
  RefineStep& last = steps_.back();
  const Candidate* asked_for = last.diagnosis.recommended();
  if (!asked_for || is_full() || !left_out_.insert(key_of(asked_for->request)).second) return false;
  if (!conclude_beside(last.diagnosis, *last.fit, left_out_))
    last.diagnosis = diagnose_now(*last.fit);
  return true;
}

Refinement::Trial Refinement::trial_of(const Move& move, std::size_t number,
                                       const Trial* on_top_of) const {
  const Fit& fit = *steps_.back().fit;
  Trial trial = on_top_of ? *on_top_of : Trial{0, fit.specification(), {}, nullptr};
  trial.move = number;
  trial.specification = apply(trial.specification, move, fit.context());
  if (!move.added) return trial;
  trial.starts.insert(move.added->starts.begin(), move.added->starts.end());
  if (is_table(*move.added)) return trial;
  for (const Parameter& p : move.added->parameters) trial.starts.emplace(p.name, p.value);
  return trial;
}

// The first move from `next` on whose model is new and, since most moves are accepted and cores are
// free, the sure one after it on top of that. Leaves `next` behind the moves considered.
std::vector<Refinement::Trial> Refinement::next_trials(const std::vector<Move>& moves,
                                                       std::size_t& next) const {
  const std::size_t most = processors() > 1 ? 2 : 1;
  std::vector<Trial> trials;
  for (; next < moves.size() && trials.size() < most; ++next) {
    const Move& move = moves[next];
    if (!trials.empty() && !move.sure) break;
    if (move.added && gone_.contains(label(move.added->request))) continue;
    Trial trial = trial_of(move, next, trials.empty() ? nullptr : &trials.back());
    const std::string model = trial.specification.to_json().dump();
    if ((move.added && taken_.contains(model)) || refused_.contains(model)) continue;
    trials.push_back(std::move(trial));
  }
  return trials;
}

// Makes the sure moves of one search or, if none is accepted, the first other one that is. Returns
// false if no move was made.
bool Refinement::one_round() {
  const Diagnosis& d = steps_.back().diagnosis;
  std::vector<Move> moves = moves_of(d);
  // Beside an unexplained structure an effect can seem superfluous because the structure's smooth
  // function takes over what the effect explains. A balancer was, when its state was what is
  // missing.
  if (d.verdict == Verdict::kUnexplainedStructure && !removes_beside_structure_)
    std::erase_if(moves, [](const Move& move) { return !move.removed.empty(); });
  bool moved = false;
  for (std::size_t next = 0; next < moves.size() && !is_full();) {
    if (moved && !moves[next].sure) return true;
    std::vector<Trial> trials = next_trials(moves, next);
    fit_trials(trials, true);
    for (const Trial& trial : trials) {
      if (is_full()) return moved;
      if (!accept(moves[trial.move], trial)) {
        next = trial.move + 1;  // a trial on top of a refused one says nothing
        break;
      }
      moved = true;
    }
  }
  return moved;
}

// A search linearises each effect about the present fit. That can be wrong: how far a base that
// tilts under load moves the tool depends on the base's height, which an arm with vertical axes
// does not show without the tilt. If a search leaves a structure unexplained, the candidates that
// explain most alone are therefore fitted, and the search continues from those that then explain
// the structure. The first one that is probable in the end, with no structure left, is kept;
// returns true then. Not beside a grid, which follows any function of its joints: there any effect
// that compensates the size of its cells would be probable.
bool Refinement::explain_structure() {
  const Diagnosis& left = steps_.back().diagnosis;
  const int steps_left = options_.most_steps - static_cast<int>(steps_.size());
  // If held-out poses refused the recommended candidates, similar ones are no better.
  if (left.verdict != Verdict::kUnexplainedStructure || steps_left < 0 || !left_out_.empty() ||
      has_grid(steps_.back().fit->model()))
    return false;
  const BlockScore structure =
      left.unexplained().empty() ? BlockScore{} : left.unexplained().front().score;
  std::vector<const Candidate*> nearest;
  for (const Candidate& c : left.candidates) {
    if (!is_table(c) && c.delta_bic < kShowsAlone && c.score.gain > kMightExplain * structure.gain)
      nearest.push_back(&c);
  }
  std::ranges::stable_sort(nearest, {}, &Candidate::delta_bic);
  if (nearest.size() > kFittedForStructure) nearest.resize(kFittedForStructure);
  const double before = steps_.back().fit->train_error().rms;
  const RefineOptions unseen{steps_left, {}, {}};
  int tried = 0;
  for (const Candidate* c : nearest) {
    Move move{*c, {}};
    for (const Candidate& other : left.candidates) {
      if (names(other, *c) && !names(*move.added, other))
        move.added->confounded_with.push_back(label(other.request));
    }
    std::vector<Trial> trial{trial_of(move, 0, nullptr)};
    if (taken_.contains(trial.front().specification.to_json().dump())) continue;
    fit_trials(trial);
    if (!trial.front().fit) continue;
    const double share = 1.0 - std::pow(trial.front().fit->train_error().rms / before, 2);
    if (share < kExplainsStructure * structure.explained) continue;
    if (++tried > kTriedForStructure) break;
    const auto explains = [&](const Diagnosis& d) {
      return !d.has_structure() && probability_of_set(d, *move.added) > kMoreLikelyThanNot;
    };
    Refinement beside(trial.front().fit, unseen, observer_, initial_);
    if (!explains(beside.steps_.front().diagnosis)) continue;
    beside.search();
    if (!explains(beside.steps_.back().diagnosis) || !accept(move, trial.front())) continue;
    beside.refine_tables();
    steps_.back().diagnosis = std::move(beside.steps_.front().diagnosis);
    for (std::size_t i = 1; i < beside.steps_.size(); ++i) {
      show();
      steps_.push_back(std::move(beside.steps_[i]));
    }
    return true;
  }
  return false;
}

// Removes what seems superfluous beside a structure that no candidate explained, and tries again.
bool Refinement::explain_without_superfluous() {
  removes_beside_structure_ = true;
  const std::size_t steps = steps_.size();
  search();
  return steps_.size() > steps && explain_structure();
}

// Tries tables with more nodes and keeps those that predict held-out poses better.
void Refinement::refine_tables() {
  const std::size_t effects = steps_.back().fit->specification().effects.size();
  for (std::size_t e = 0; e < effects; ++e) {
    if (is_full()) return;
    const Fit& fit = *steps_.back().fit;
    const EffectRequest& present = fit.specification().effects[e];
    const auto finer = find_effect(present.effect).finer(fit.context(), present);
    if (!finer) continue;
    observer_.report(1.0, "trying finer tables");
    ModelSpecification specification = fit.specification();
    specification.effects[e] = *finer;
    std::shared_ptr<Fit> changed =
        fit_or_none([&] { return from_the_beginning(fit, specification); });
    if (!changed) continue;
    const Growth growth = held_out_growth(fit, *changed, true);
    if (growth.mean > growth.sigma ||
        changed->held_out_with_history().errors[0].mean >
            (1.0 - kWorthNodes) * fit.held_out_with_history().errors[0].mean)
      continue;
    show();
    Candidate added;
    added.request = *finer;
    steps_.push_back({std::move(added), {}, steps_.back().diagnosis, changed});
    settled_ = std::move(changed);
    is_diagnosed_ = false;
  }
}

}  // namespace

std::vector<RefineStep> refine(std::shared_ptr<Fit> fit, const RefineOptions& options,
                               Observer& observer) {
  return Refinement(std::move(fit), options, observer).run();
}

}  // namespace armtrue
