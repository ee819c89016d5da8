#include "fitter/solve/fit.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <nlohmann/json.hpp>
#include <numeric>
#include <set>
#include <utility>

#include "fitter/design/placement.h"
#include "fitter/inference/orientation_worth.h"
#include "fitter/solve/choose_options.h"
#include "fitter/solve/gross_errors.h"
#include "fitter/start/start_search.h"

namespace armtrue {
namespace {

constexpr int kRobustPasses = 8;
constexpr double kSmoothnessStart = 1e-4;  // [rad]
// The smoothness of tables is chosen anew where the noise has changed by more than this share.
constexpr double kSameNoise = 0.05;
// Terms that depend on springs of the same fit are repeated: one or two repetitions suffice.
constexpr int kSpringPasses = 6;
constexpr double kSpringsStand = 1e-3;  // relative to the largest spring
// A prior that holds a value back is widened to that value and the fit repeated, until no value
// exceeds its prior by more than this factor.
constexpr int kPriorPasses = 6;
constexpr double kClearlyWider = 1.1;
// Loads are computed for the deflected arm, and the fit is repeated while that moves a frame by
// more than this, which is far less than any instrument resolves.
constexpr int kStancePasses = 4;
constexpr double kStands = 1e-7;  // [m, or rad]
// Loads of the nominal arm are accepted only where they lower Σ r² by this, likelihood odds of 4.5
// to one, because most arms deflect under load.
constexpr double kForNominalLoads = 3.0;

// True if starting values of a nonlinear parameter are still to be searched for.
bool is_searched(const Model& model) {
  return std::any_of(model.nonlinear.begin(), model.nonlinear.end(),
                     [](const NonlinearParameter& p) { return !p.starts.empty(); });
}

}  // namespace

// Terms of some effects depend on springs, or on a balancer, that the same fit estimates, so the
// fit is repeated until these no longer change.
std::unique_ptr<Fit> Fit::run(const Robot& robot, const State::Columns& columns,
                              const ModelSpecification& specification, const FitOptions& options,
                              Observer& observer) {
  const auto reads_springs = [](const EffectRequest& e) {
    return find_effect(e.effect).reads_springs();
  };
  const auto reads_carried = [](const EffectRequest& e) {
    return find_effect(e.effect).reads_carried();
  };
  if (std::ranges::none_of(specification.effects, reads_springs))
    return run_once(robot, columns, specification, options, observer);
  FitOptions trial = options;
  trial.cross_validate = false;
  if (!trial.start || trial.start->springs.empty()) {
    const ModelSpecification simpler = specification.without(reads_springs);
    std::unique_ptr<Fit> first = run_once(robot, columns, simpler, trial, observer);
    if (std::ranges::any_of(specification.effects, reads_carried)) {
      const std::set<std::string> hiding = effects_hiding_loads(first->model());
      const auto hides = [&](const EffectRequest& e) { return hiding.contains(e.effect); };
      if (!hiding.empty())
        first = run_once(robot, columns, simpler.without(hides), trial, observer);
    }
    trial.start = std::make_shared<StartPoint>(first->start_point());
  }
  std::unique_ptr<Fit> fit;
  for (int pass = 0; pass < kSpringPasses; ++pass) {
    fit = run_once(robot, columns, specification, trial, observer);
    const double change = fit->change_since(*trial.start);
    trial.start = std::make_shared<StartPoint>(fit->start_point());
    if (change < kSpringsStand) break;
  }
  if (options.cross_validate) fit->cross_validate();
  return fit;
}

std::unique_ptr<Fit> Fit::run_once(const Robot& robot, const State::Columns& columns,
                                   const ModelSpecification& specification,
                                   const FitOptions& options, Observer& observer) {
  std::unique_ptr<Fit> fit(new Fit);
  fit->options_ = options;
  observer.report(0.0, "aligning");
  fit->prepared_ =
      options.start ? options.start->prepared
                    : prepare(robot, columns,
                              {options.instrument, options.assumed_sigma, options.sigma_rotation});
  const bool is_standing = options.start && options.start->state;
  fit->state_ =
      std::make_shared<State>(is_standing ? *options.start->state : *fit->prepared_->state);
  fit->specification_ = close_options(fit->state(), specification, options);
  fit->begin();
  observer.report(0.1, "solving");
  fit->kept_weights_ = fit->keeps_weights();
  if (fit->kept_weights_) {
    fit->solve_as_weighed();
  } else {
    fit->solve_robustly();
    fit->choose_where_loads_act();
  }
  observer.report(0.6, "counting unknowns");
  fit->fold_base_and_tool();
  const EvaluatedRows evaluated = evaluate_rows(*fit->design_);
  fit->uncertainty_ =
      measure_uncertainty(*fit->design_, evaluated, fit->smoothness_.sigma, fit->effective_guess_);
  observer.report(0.7, "held-out errors");
  fit->measure_errors();
  if (options.cross_validate) fit->predict_held_out(evaluated);
  fit->noise_floor_ =
      measure_noise_floor(*fit->design_, fit->train_with_history_, fit->effective_unknowns(),
                          fit->measurements_.typical_sigma / fit->noise_scale_);
  fit->context_->springs = springs_of(fit->model_, fit->robot().joint_count());
  fit->context_->carried = carried_of(fit->model_);
  fit->context_->measuring_from_base = fit->kinematics_->base().linear();
  fit->options_.start.reset();
  fit->options_.keeps_weights = false;
  observer.report(1.0, "done");
  return fit;
}

void Fit::begin() {
  measurements_ = prepared_->measurements;
  warnings_ = prepared_->warnings;
  const Alignment& alignment = prepared_->alignment;
  kinematics_ = std::make_unique<Kinematics>(robot(), measurements_.targets);
  context_ = std::make_unique<EffectContext>(EffectContext{
      state(), measurements_.targets, measurements_.turns_of_targets(), specification_.priors,
      options_.start ? options_.start->springs : std::vector<Spring>{},
      options_.start ? options_.start->carried : std::map<std::string, Expression>{},
      options_.instrument ? options_.instrument->position : Eigen::Vector3d::Zero(),
      alignment.measuring_from_base.linear()});
  model_ = build_model(specification_, *context_);
  const auto places = [&](Place place) {
    return std::ranges::any_of(model_.parameters, [&](const Parameter& p) {
      return find_effect(p.effect).role() == Role::kPlacement &&
             p.terms.front().coordinate.place == place;
    });
  };
  const bool free_base = places(Place::kBase) || !robot().measuring_from_base;
  const bool free_tool = places(Place::kTool) || !robot().nominal_tool(0);
  kinematics_->set_base(free_base ? alignment.measuring_from_base : *robot().measuring_from_base);
  for (int t = 0; t < measurements_.targets; ++t) {
    kinematics_->set_tool(t, free_tool ? alignment.flange_from_tool[static_cast<std::size_t>(t)]
                                       : *robot().nominal_tool(t));
  }
  nominal_ = summarise(alignment.residual_m);
  if (options_.start) {
    smoothness_.scale = options_.start->smoothness.scale;
    orientation_inflation_ = options_.start->orientation_inflation;
    for (const auto& [effect, factor] : smoothness_.scale) scale_smoothness(model_, effect, factor);
  }
  place_as_stated(specification_, model_, *kinematics_);
  for (NonlinearParameter& p : model_.nonlinear) {
    if (const auto start = options_.nonlinear_starts.find(p.name);
        start != options_.nonlinear_starts.end()) {
      p.value = start->second;
      if (is_newly_followed(p)) continue;
      p.starts.clear();
    } else if (const auto guess = options_.nonlinear_guesses.find(p.name);
               guess != options_.nonlinear_guesses.end()) {
      p.value = guess->second;
      p.starts.push_back(guess->second);
    }
  }
  design_ = std::make_unique<Design>(state(), measurements_, model_, *kinematics_);
  const std::size_t equations =
      measurements_.rows * static_cast<std::size_t>(measurements_.residuals_per_row());
  if (equations < 12) {
    throw ModelError("measurements: found " + std::to_string(measurements_.rows) +
                     " poses, expected at least 4");
  }
}

// Whether a term of the model, but none of the start's, follows the load that the parameter's
// effect carries. Such a term can contradict the value of the start, which is then only one of
// many.
bool Fit::is_newly_followed(const NonlinearParameter& parameter) const {
  const auto load = find_effect(parameter.effect).carries();
  return load && std::ranges::any_of(model_.parameters, [&](const Parameter& p) {
           const bool is_new = !options_.start || !options_.start->values.contains(p.name) ||
                               options_.nonlinear_guesses.contains(p.name);
           return is_new && std::ranges::any_of(p.terms, [&](const Term& term) {
                    return term.follows && term.follows->load == load->torque;
                  });
         });
}

void Fit::scale_noise(double factor) {
  noise_scale_ *= factor;
  for (Eigen::Matrix3d& w : measurements_.whiten_position) w /= factor;
  measurements_.typical_sigma *= factor;
}

// Scales the stated sigma to the scatter of the residuals, so that priors have the right weight.
void Fit::rescale_noise() {
  std::vector<double> size;
  Design::Row row;
  for (std::size_t i = 0; i < design_->rows(); ++i) {
    if (design_->weights()[i] == 0.0) continue;
    design_->evaluate(i, false, row);
    size.push_back(row.residual.head<3>().norm());
  }
  const double equations = static_cast<double>(size.size()) * design_->residuals_per_row();
  double unknowns = design_->unknowns();
  if (has_tables(model_)) {
    if (!knows_effective_unknowns_) {
      effective_guess_ = count_effective_unknowns(*design_, accumulate(*design_), smoothness_.sigma,
                                                  effective_guess_);
      knows_effective_unknowns_ = true;
    }
    unknowns = effective_guess_;
  }
  const double freedom = std::max(0.2, 1.0 - unknowns / equations);
  const double scale = std::max(1e-3, median(size) / kMedianChi3 / std::sqrt(freedom));
  scale_noise(scale);
  if (!measurements_.has_rotation()) return;
  std::vector<double> turn;
  for (std::size_t i = 0; i < design_->rows(); ++i) {
    if (design_->weights()[i] == 0.0 || measurements_.rotation_is_copied[i]) continue;
    design_->evaluate(i, false, row);
    turn.push_back(row.residual.tail<3>().norm());
  }
  measurements_.sigma_rotation *=
      orientation_inflation_ * std::max(1e-3, median(turn) / kMedianChi3 / std::sqrt(freedom));
}

// Widens a prior up to the physical bound where the data show a larger value than is usual (masses
// of another version of the arm, without gears and motors). Otherwise a different effect would be
// found that only brings the value back to its usual size.
void Fit::solve_with_wider_priors() {
  for (int pass = 0; pass < kPriorPasses; ++pass) {
    bool wider = false;
    for (std::size_t i = 0; i < model_.parameters.size(); ++i) {
      Parameter& p = model_.parameters[i];
      if (!p.may_be_unusual() || specification_.overrides.contains(p.name)) continue;
      const double size = std::min(std::abs(design_->values()[i] - p.prior_mean), p.bound);
      wider = wider || size > kClearlyWider * p.prior_sigma;
      p.prior_sigma = std::max(p.prior_sigma, size);
    }
    if (!wider) return;
    solve_from_here();
  }
}

void Fit::weigh_orientations() {
  measurements_.sigma_rotation /= orientation_inflation_;
  orientation_inflation_ = orientation_inflation(*design_, evaluate_rows(*design_),
                                                 smoothness_.sigma, options_.seed + 1);
  measurements_.sigma_rotation *= orientation_inflation_;
  solve_from_here();
  rescale_noise();
}

bool Fit::has_the_nodes_of_the_start() const {
  return std::ranges::all_of(model_.parameters, [&](const Parameter& p) {
    return p.terms.empty() || !p.terms.front().table || options_.start->values.contains(p.name);
  });
}

// True if the start has the same tables and its smoothness was chosen at nearly the same noise.
bool Fit::smoothness_stands() const {
  if (!options_.start || options_.start->smoothness.sigma <= 0.0) return false;
  const double change = measurements_.typical_sigma / options_.start->smoothness.noise;
  return std::abs(change - 1.0) < kSameNoise && has_the_nodes_of_the_start();
}

// Returns true if the smoothness changed.
bool Fit::change_smoothness() {
  if (!has_tables(model_) || options_.smoothness_sigma) return false;
  if (smoothness_stands()) {
    smoothness_.noise = options_.start->smoothness.noise;
    return false;
  }
  const Smoothness before =
      std::exchange(smoothness_, choose_smoothness(*design_, model_, smoothness_));
  if (smoothness_.sigma == before.sigma && smoothness_.scale == before.scale) return false;
  knows_effective_unknowns_ = false;
  return true;
}

bool Fit::find_gross_errors() {
  const std::vector<double> distance = residual_distances(*design_);
  std::vector<double> kept;
  for (std::size_t i = 0; i < distance.size(); ++i) {
    if (design_->weights()[i] > 0.0) kept.push_back(distance[i]);
  }
  const double limit = gross_limit(kept, robot().reach());
  std::vector<std::size_t> gross;
  for (std::size_t i = 0; i < distance.size(); ++i) {
    if (distance[i] > limit) gross.push_back(i);
  }
  std::vector<double> weights(distance.size(), 1.0);
  for (const std::size_t i : gross) weights[i] = 0.0;
  const bool changed = weights != design_->weights();
  design_->weights() = weights;
  rejected_.clear();
  for (const std::size_t i : gross) rejected_.push_back({i, distance[i]});
  return changed;
}

double Fit::stand_as_fitted() { return design_->stand(*state_); }

void Fit::solve_from_here(Accuracy accuracy) {
  for (int pass = 0; pass < kStancePasses; ++pass) {
    summary_ = solve(*design_, smoothness_.sigma, accuracy);
    solver_iterations_ += summary_.iterations;
    if (stand_as_fitted() < kStands) break;
  }
}

// Solves from the present values and, if nonlinear parameters are searched for, also from a new
// search: a value that gross errors led into a wrong minimum does not leave it by descent. Keeps
// the lower cost.
void Fit::solve_from_anywhere() {
  solve_from_here();
  if (!is_searched(model_)) return;
  const SolveSummary here = summary_;
  const std::vector<double> present = design_->unknown_values();
  design_->set_unknowns(search_starts(*design_, smoothness_.sigma).data());
  solve_from_here();
  if (summary_.cost < here.cost) return;
  summary_ = here;
  design_->set_unknowns(present.data());
  stand_as_fitted();
}

// Frees the parameters that the data determine and holds the others.
void Fit::choose_free() {
  std::vector<int> all(model_.parameters.size());
  std::iota(all.begin(), all.end(), 0);
  design_->set_free(all);
  identifiability_ = identify(*design_);
  design_->set_free(identifiability_.kept);
  // Held parameters return to nominal: a value of an earlier choice would not be an estimate.
  std::vector<double> values = design_->values();
  for (const Unidentifiable& held : identifiability_.held) {
    const auto index = static_cast<std::size_t>(held.parameter);
    values[index] = model_.parameters[index].prior_mean;
  }
  design_->set_values(values);
}

bool Fit::keeps_weights() const {
  return options_.keeps_weights && options_.start && !is_searched(model_) &&
         has_the_nodes_of_the_start();
}

// Effective unknowns of the start, plus one for each added unknown outside tables.
void Fit::count_from(const StartPoint& start) {
  effective_guess_ =
      start.effective_unknowns + design_->unknowns_beside_tables() - start.unknowns_beside_tables;
  knows_effective_unknowns_ = true;
}

// Step between two full fits: solves for the coefficients and the scale of the noise.
void Fit::solve_as_weighed() {
  const StartPoint& start = *options_.start;
  smoothness_ = start.smoothness;
  design_->weights() = start.weights;
  scale_noise(start.noise_scale);
  measurements_.sigma_rotation = start.sigma_rotation;
  // First, as identifiability depends on the values: a base that tilts under load shows its height.
  begin_at(start);
  choose_free();
  count_from(start);
  solve_from_anywhere();
  solve_with_wider_priors();
  rescale_noise();
  solve_from_here(Accuracy::kFull);
  if (options_.reject_gross_errors && find_gross_errors()) solve_from_here(Accuracy::kFull);
  if (!summary_.converged) warnings_.push_back("the solver did not converge: " + summary_.message);
}

void Fit::solve_robustly() {
  const bool begun = options_.start && options_.start->smoothness.sigma > 0.0;
  smoothness_.sigma = options_.smoothness_sigma.value_or(begun ? options_.start->smoothness.sigma
                                                               : kSmoothnessStart);
  // Rows with a gross alignment residual are excluded from the first step on.
  const std::vector<double>& aligned = prepared_->alignment.residual_m;
  const double limit = gross_limit(aligned, robot().reach());
  std::vector<double>& weights = design_->weights();
  for (std::size_t i = 0; i < weights.size(); ++i) {
    weights[i] = options_.reject_gross_errors && aligned[i] > limit ? 0.0 : 1.0;
  }
  choose_free();
  if (begun) count_from(*options_.start);
  if (is_searched(model_)) {
    design_->set_unknowns(search_starts(*design_, smoothness_.sigma).data());
  } else if (options_.start) {
    begin_at(*options_.start);
  }
  solve_from_here();
  if (options_.reject_gross_errors) {
    for (int pass = 0; pass < kRobustPasses; ++pass) {
      if (!find_gross_errors()) break;
      solve_from_anywhere();
    }
  }
  rescale_noise();
  choose_free();
  solve_from_here();
  solve_with_wider_priors();
  if (change_smoothness()) {
    solve_from_here();
    rescale_noise();
  }
  if (measurements_.has_rotation()) weigh_orientations();
  solve_from_here(Accuracy::kFull);
  if (options_.reject_gross_errors && find_gross_errors()) solve_from_here(Accuracy::kFull);
  if (!summary_.converged) warnings_.push_back("the solver did not converge: " + summary_.message);
}

// Solves with loads of the deflected arm and with loads of the nominal arm at commanded angles, as
// simulators often compute them, and keeps the likelier. The two differ by a few micrometres, which
// would otherwise be attributed to effects that are not present.
void Fit::choose_where_loads_act() {
  if (!design_->reads_loads()) return;
  const bool follow = state_->loads_follow();
  const SolveSummary here = summary_;
  const std::vector<double> present = design_->unknown_values();
  state_->let_loads_follow(!follow);
  stand_as_fitted();
  solve_from_here(Accuracy::kFull);
  const double following = follow ? here.cost : summary_.cost;
  const double nominal = follow ? summary_.cost : here.cost;
  if (follow == (following - nominal > kForNominalLoads)) {
    rescale_noise();
    solve_from_here(Accuracy::kFull);
    return;
  }
  state_->let_loads_follow(follow);
  design_->set_unknowns(present.data());
  stand_as_fitted();
  summary_ = here;
}

// Moves the fitted corrections of base and tool into their reference poses and zeroes them.
void Fit::fold_base_and_tool() {
  std::vector<double> values = design_->values();
  Eigen::VectorXd coordinates = Eigen::VectorXd::Zero(kinematics_->layout().size());
  for (std::size_t i = 0; i < model_.parameters.size(); ++i) {
    const Parameter& p = model_.parameters[i];
    if (find_effect(p.effect).role() == Role::kPlacement) {
      coordinates[kinematics_->layout().index(p.terms.front().coordinate)] += values[i];
      values[i] = 0.0;
    }
    model_.parameters[i].value = values[i];
  }
  for (std::size_t j = 0; j < model_.nonlinear.size(); ++j) {
    model_.nonlinear[j].value = design_->unknown_values()[design_->free_parameters().size() + j];
  }
  const auto moved = [&](const Pose& pose, int first) {
    Pose result = pose;
    result.translate(Eigen::Vector3d(coordinates.segment<3>(first)));
    result.linear() = result.linear() * rotation_exp(coordinates.segment<3>(first + 3));
    return result;
  };
  const CoordinateLayout layout = kinematics_->layout();
  kinematics_->set_base(moved(kinematics_->base(), layout.base(0)));
  for (int t = 0; t < layout.targets; ++t)
    kinematics_->set_tool(t, moved(kinematics_->tool(t), layout.tool(t, 0)));
  std::vector<double> weights = design_->weights();
  design_ = std::make_unique<Design>(state(), measurements_, model_, *kinematics_);
  design_->weights() = weights;
  design_->set_free(identifiability_.kept);
  stand_as_fitted();
}

Eigen::MatrixXd Fit::covariance() const {
  return covariance_of(*design_, smoothness_.sigma, effective_unknowns());
}

}  // namespace armtrue
