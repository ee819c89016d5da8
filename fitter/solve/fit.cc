#include "fitter/solve/fit.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <map>
#include <nlohmann/json.hpp>
#include <numeric>
#include <set>
#include <utility>

#include "fitter/solve/choose_options.h"
#include "fitter/solve/dense.h"
#include "fitter/solve/effect_sizes.h"
#include "fitter/solve/placement.h"
#include "fitter/solve/replicates.h"
#include "fitter/solve/stance.h"
#include "fitter/solve/start_search.h"
#include "fitter/solve/table_evidence.h"

namespace armtrue {
namespace {

using nlohmann::json;

// Median of the distance of three independent unit normals (chi with three degrees of freedom), and
// its mean.
constexpr double kMedianChi3 = 1.5381722;
constexpr double kMeanChi3 = 1.5957691;
// Of the square of that distance: its median, and what one in a thousand exceeds.
constexpr double kMedianChiSquared3 = 2.3659739;
constexpr double kLargestChiSquared3 = 16.2662362;
constexpr std::size_t kLeastFloorFreedom = 9;
constexpr double kFloorAboveResidual = 1.25;  // more than few repeats scatter by
// A bumped reflector stands this many robust standard deviations out; model errors of honest rows
// do not.
constexpr double kGrossError = 8.0;
constexpr double kLargestGrossShare = 0.1;
constexpr double kAboveStructure = 3.0;
constexpr int kRobustPasses = 8;
constexpr double kSmoothnessStart = 1e-4;  // [rad]
// The smoothness of tables is chosen anew where the noise has changed by more than this share.
constexpr double kSameNoise = 0.05;
constexpr int kSmoothnessPasses = 2;
constexpr std::array<double, 6> kSmoothnessFactors{0.03, 0.1, 0.3, 3.0, 10.0, 30.0};
constexpr int kVariancePasses = 6;
constexpr double kSettled = 1e-3;  // of the equations
// Springs that a fit's own terms are weighed by are found in one or two repetitions.
constexpr int kSpringPasses = 6;
constexpr double kSpringsStand = 1e-3;  // of the largest
// Loads are worked out where the fitted arm stands, and the fit repeated while that moves a frame
// by more than this: far less than any instrument sees.
constexpr int kStancePasses = 4;
constexpr double kStands = 1e-7;          // [m, or rad]
constexpr double kLearntInFull = 1e-300;  // variance over that before; its logarithm is finite

json to_json(const ErrorSummary& s) {
  return {{"mean_um", s.mean * 1e6},
          {"rms_um", s.rms * 1e6},
          {"p95_um", s.p95 * 1e6},
          {"max_um", s.max * 1e6},
          {"n", s.count}};
}

json to_json(const Pose& pose) {
  const Eigen::Vector3d p = pose.translation();
  const Eigen::Vector3d a = rpy_from_rotation(pose.linear());
  return {{"xyz", {p.x(), p.y(), p.z()}}, {"rpy", {a.x(), a.y(), a.z()}}};
}

// False where all that could be searched for has a start of its own already.
bool is_searched(const Model& model) {
  return std::any_of(model.nonlinear.begin(), model.nonlinear.end(),
                     [](const NonlinearParameter& p) { return !p.starts.empty(); });
}

// Largest change of a spring between two fits of one model, as a part of the largest spring.
double largest_change(const std::vector<Spring>& before, const std::vector<Spring>& after) {
  if (before.size() != after.size()) return 1.0;
  double change = 0.0, largest = 0.0;
  for (std::size_t i = 0; i < after.size(); ++i) {
    change = std::max(change, std::abs(after[i].compliance - before[i].compliance));
    largest = std::max(largest, std::abs(after[i].compliance));
  }
  return largest > 0.0 ? change / largest : 0.0;
}

// What every fit to these measurements begins with.
std::shared_ptr<const Prepared> prepare(const Robot& robot, const State::Columns& columns,
                                        const FitOptions& options) {
  auto prepared = std::make_shared<Prepared>();
  prepared->robot = robot;
  std::optional<Eigen::Vector3d> payload_point = robot.payload_point;
  const bool has_tool_point = robot.flange_from_tool.has_value();
  if (!payload_point) {
    if (const std::optional<Pose> tool =
            has_tool_point ? robot.flange_from_tool : robot.nominal_tool(0)) {
      payload_point = tool->translation();
    }
  }
  const auto state_with = [&](const Eigen::Vector3d& point) {
    auto state = std::make_unique<State>(prepared->robot, columns, point);
    state->smooth_torques();
    if (state->recorded("time"))
      state->begin_time_at(*std::ranges::min_element(state->columns().at("time")));
    return state;
  };
  prepared->state = state_with(payload_point.value_or(Eigen::Vector3d::Zero()));
  prepared->measurements = Measurements::from_state(*prepared->state, options.instrument,
                                                    options.assumed_sigma, options.sigma_rotation);
  prepared->alignment = align(*prepared->state, prepared->measurements);
  if (!payload_point) {
    // The payload hangs at the tool point, which is known only now.
    prepared->state = state_with(prepared->alignment.flange_from_tool.front().translation());
  }
  if (prepared->state->has("payload") && prepared->measurements.targets > 1 &&
      !robot.payload_point && !has_tool_point) {
    prepared->warnings.push_back(
        "the payload is taken to hang at the first reflector: robot.yaml names neither a tool nor "
        "the payload's centre of mass (payload: {com: [x, y, z]})");
  }
  return prepared;
}

}  // namespace

// Some effects' terms are weighed by springs that the same fit finds: it is repeated until they
// agree.
std::unique_ptr<Fit> Fit::run(const Robot& robot, const State::Columns& columns,
                              const ModelSpecification& specification, const FitOptions& options,
                              Observer& observer) {
  const auto reads_springs = [](const EffectRequest& e) {
    return find_effect(e.effect).reads_springs();
  };
  if (std::none_of(specification.effects.begin(), specification.effects.end(), reads_springs))
    return run_once(robot, columns, specification, options, observer);
  FitOptions trial = options;
  trial.cross_validate = false;
  if (!trial.start || trial.start->springs.empty()) {
    ModelSpecification without = specification;
    std::erase_if(without.effects, reads_springs);
    for (const EffectRequest& e : specification.effects) {
      if (!reads_springs(e)) continue;
      std::erase_if(without.overrides,
                    [&](const auto& entry) { return entry.first.starts_with(e.effect + "."); });
    }
    trial.start = std::make_shared<StartPoint>(
        run_once(robot, columns, without, trial, observer)->start_point());
  }
  std::unique_ptr<Fit> fit;
  for (int pass = 0; pass < kSpringPasses; ++pass) {
    fit = run_once(robot, columns, specification, trial, observer);
    const double change = largest_change(trial.start->springs, fit->context().springs);
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
  fit->prepared_ = options.start ? options.start->prepared : prepare(robot, columns, options);
  const bool is_standing = options.start && options.start->state;
  fit->state_ =
      std::make_shared<State>(is_standing ? *options.start->state : *fit->prepared_->state);
  fit->specification_ = close_options(fit->state(), specification, options);
  fit->begin();
  observer.report(0.1, "solving");
  fit->solve_robustly();
  observer.report(0.6, "covariance");
  fit->fold_base_and_tool();
  const EvaluatedRows evaluated = evaluate_rows(*fit->design_);
  fit->compute_covariance(evaluated);
  observer.report(0.7, "held-out errors");
  fit->measure_errors();
  if (options.cross_validate) {
    fit->measure_held_out_errors(evaluated);
  } else {
    fit->held_out_.assign(3, ErrorSummary{});
    fit->held_out_distances_.assign(3, {});
  }
  fit->measure_noise_floor();
  fit->context_->springs = springs_of(fit->model_, fit->robot().joint_count());
  fit->context_->carried = carried_of(fit->model_);
  fit->context_->measuring_from_base = fit->kinematics_->base().linear();
  fit->options_.start.reset();
  observer.report(1.0, "done");
  return fit;
}

void Fit::begin() {
  measurements_ = prepared_->measurements;
  warnings_ = prepared_->warnings;
  const Alignment& alignment = prepared_->alignment;
  kinematics_ = std::make_unique<Kinematics>(robot(), measurements_.targets);
  context_ = std::make_unique<EffectContext>(EffectContext{
      state(), measurements_.targets, measurements_.has_rotation(), specification_.priors,
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
    for (const auto& [effect, factor] : options_.start->smoothness_scale)
      scale_smoothness(effect, factor);
  }
  place_as_stated(specification_, model_, *kinematics_);
  for (NonlinearParameter& p : model_.nonlinear) {
    if (const auto start = options_.nonlinear_starts.find(p.name);
        start != options_.nonlinear_starts.end()) {
      p.value = start->second;
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

// Brings the stated sigma to what the residuals show, so that priors weigh what they should.
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
  if (smooth()) {
    count_effective_unknowns(accumulate(*design_));
    unknowns = effective_unknowns_;
  }
  const double freedom = std::max(0.2, 1.0 - unknowns / equations);
  const double scale = std::max(1e-3, median(size) / kMedianChi3 / std::sqrt(freedom));
  noise_scale_ *= scale;
  for (Eigen::Matrix3d& w : measurements_.whiten_position) w /= scale;
  measurements_.typical_sigma *= scale;
  if (!measurements_.has_rotation()) return;
  std::vector<double> turn;
  for (std::size_t i = 0; i < design_->rows(); ++i) {
    if (design_->weights()[i] == 0.0) continue;
    design_->evaluate(i, false, row);
    turn.push_back(row.residual.tail<3>().norm());
  }
  measurements_.sigma_rotation *= std::max(1e-3, median(turn) / kMedianChi3 / std::sqrt(freedom));
}

bool Fit::smooth() const {
  return std::any_of(model_.penalties.begin(), model_.penalties.end(),
                     [](const Penalty& p) { return p.smoothness; });
}

// True where the same tables were as smooth beside a noise that hardly differed.
bool Fit::smoothness_stands() const {
  if (!options_.start || options_.start->smoothness_sigma <= 0.0) return false;
  const double change = measurements_.typical_sigma / options_.start->smoothness_noise;
  return std::abs(change - 1.0) < kSameNoise &&
         std::ranges::all_of(model_.parameters, [&](const Parameter& p) {
           return p.terms.empty() || !p.terms.front().table ||
                  options_.start->values.contains(p.name);
         });
}

// Tables of one effect are as smooth as each other; those of another one need not be.
void Fit::scale_smoothness(const std::string& effect, double factor) {
  smoothness_scale_.try_emplace(effect, 1.0).first->second *= factor;
  for (Penalty& penalty : model_.penalties) {
    if (penalty.smoothness && effect_of(penalty) == effect) penalty.sigma *= factor;
  }
}

const std::string& Fit::effect_of(const Penalty& penalty) const {
  const auto at = static_cast<std::size_t>(model_.index(penalty.row.front().first));
  return model_.parameters[at].effect;
}

// True where it is not what it was.
bool Fit::choose_smoothness() {
  if (!smooth() || options_.smoothness_sigma) return false;
  if (smoothness_stands()) {
    smoothness_noise_ = options_.start->smoothness_noise;
    return false;
  }
  const double sigma = smoothness_sigma_;
  const std::map<std::string, double> scale = smoothness_scale_;
  const NormalEquations data = accumulate(*design_);
  const auto [likeliest, evidence] = likeliest_smoothness(*design_, data, smoothnesses());
  smoothness_sigma_ = likeliest;
  smoothness_noise_ = measurements_.typical_sigma;
  std::set<std::string> effects;
  for (const Penalty& penalty : model_.penalties) {
    if (penalty.smoothness) effects.insert(effect_of(penalty));
  }
  double least = evidence;
  for (int pass = 0; effects.size() > 1 && pass < kSmoothnessPasses; ++pass) {
    for (const std::string& effect : effects) {
      double best = 1.0;
      for (const double factor : kSmoothnessFactors) {
        scale_smoothness(effect, factor);
        const double now = likeliest_smoothness(*design_, data, {smoothness_sigma_}).evidence;
        scale_smoothness(effect, 1.0 / factor);
        if (now >= least) continue;
        least = now;
        best = factor;
      }
      scale_smoothness(effect, best);
    }
  }
  return smoothness_sigma_ != sigma || smoothness_scale_ != scale;
}

bool Fit::find_gross_errors() {
  const std::vector<double> distance = residual_distances(*design_);
  std::vector<double> kept;
  for (std::size_t i = 0; i < distance.size(); ++i) {
    if (design_->weights()[i] > 0.0) kept.push_back(distance[i]);
  }
  // A local effect that the model lacks can stand out on many poses: bumps must stand out from
  // those too.
  const double limit = std::max(kGrossError * median(kept) / kMedianChi3,
                                kAboveStructure * quantile(kept, 1.0 - kLargestGrossShare));
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

StartPoint Fit::start_point() const {
  StartPoint start{prepared_,         {},    kinematics_->base(), {}, context_->springs,
                   context_->carried, state_};
  if (smooth()) {
    start.smoothness_sigma = smoothness_sigma_;
    start.smoothness_noise = smoothness_noise_;
    start.smoothness_scale = smoothness_scale_;
  }
  for (const Parameter& p : model_.parameters) start.values[p.name] = p.value;
  for (int t = 0; t < measurements_.targets; ++t)
    start.flange_from_tool.push_back(kinematics_->tool(t));
  return start;
}

// Sets what is free to where another fit ended; what it folded into base and tool is unfolded.
void Fit::begin_at(const StartPoint& start) {
  const CoordinateLayout layout = kinematics_->layout();
  Eigen::VectorXd coordinates = Eigen::VectorXd::Zero(layout.size());
  const auto unfold = [&](const Pose& from, const Pose& to, int first) {
    const Pose step = from.inverse() * to;
    coordinates.segment<3>(first) = step.translation();
    coordinates.segment<3>(first + 3) = rotation_log(step.linear());
  };
  unfold(kinematics_->base(), start.measuring_from_base, layout.base(0));
  for (int t = 0; t < layout.targets; ++t)
    unfold(kinematics_->tool(t), start.flange_from_tool[static_cast<std::size_t>(t)],
           layout.tool(t, 0));
  std::vector<double> values = design_->values();
  for (const int free : design_->free_parameters()) {
    const Parameter& p = model_.parameters[static_cast<std::size_t>(free)];
    double& value = values[static_cast<std::size_t>(free)];
    if (find_effect(p.effect).role() == Role::kPlacement) {
      value = coordinates[layout.index(p.terms.front().coordinate)];
    } else if (const auto at = start.values.find(p.name); at != start.values.end()) {
      value = at->second;
    }
  }
  design_->set_values(values);
}

double Fit::stand_as_fitted() { return design_->stand(*state_); }

void Fit::solve_from_here(Accuracy accuracy) {
  for (int pass = 0; pass < kStancePasses; ++pass) {
    summary_ = solve(*design_, smoothness_sigma_, accuracy);
    solver_iterations_ += summary_.iterations;
    if (stand_as_fitted() < kStands) break;
  }
}

// From the present values and, where nonlinear parameters are searched for, from a new search: what
// bumped reflectors have led astray does not come back by itself.
void Fit::solve_from_anywhere() {
  solve_from_here();
  if (!is_searched(model_)) return;
  const SolveSummary here = summary_;
  const std::vector<double> present = design_->unknown_values();
  design_->set_unknowns(search_starts(*design_, smoothness_sigma_).data());
  solve_from_here();
  if (summary_.cost < here.cost) return;
  summary_ = here;
  design_->set_unknowns(present.data());
  stand_as_fitted();
}

void Fit::solve_robustly() {
  const bool begun = options_.start && options_.start->smoothness_sigma > 0.0;
  smoothness_sigma_ = options_.smoothness_sigma.value_or(begun ? options_.start->smoothness_sigma
                                                               : kSmoothnessStart);
  // Bumps are kept out of the very first step already, where alignment shows them.
  const std::vector<double>& aligned = prepared_->alignment.residual_m;
  const double limit = std::max(kGrossError * median(aligned) / kMedianChi3,
                                kAboveStructure * quantile(aligned, 1.0 - kLargestGrossShare));
  std::vector<double>& weights = design_->weights();
  for (std::size_t i = 0; i < weights.size(); ++i) {
    weights[i] = options_.reject_gross_errors && aligned[i] > limit ? 0.0 : 1.0;
  }
  std::vector<int> all;
  for (std::size_t i = 0; i < model_.parameters.size(); ++i) all.push_back(static_cast<int>(i));
  const auto choose_kept = [&] {
    design_->set_free(all);
    identifiability_ = identify(*design_);
    design_->set_free(identifiability_.kept);
    // What is held returns to nominal: a value from an earlier choice would be nobody's estimate.
    std::vector<double> values = design_->values();
    for (const Unidentifiable& held : identifiability_.held) {
      const auto index = static_cast<std::size_t>(held.parameter);
      values[index] = model_.parameters[index].prior_mean;
    }
    design_->set_values(values);
  };
  choose_kept();
  if (is_searched(model_)) {
    design_->set_unknowns(search_starts(*design_, smoothness_sigma_).data());
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
  choose_kept();
  solve_from_here();
  if (choose_smoothness()) {
    solve_from_here();
    rescale_noise();
  }
  solve_from_here(Accuracy::kFull);
  if (options_.reject_gross_errors && find_gross_errors()) solve_from_here(Accuracy::kFull);
  if (!summary_.converged) warnings_.push_back("the solver did not converge: " + summary_.message);
}

// Base and tool become what was found, and their virtual joints start from zero again.
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

// The unknowns' covariance: what the measurements say, in `equations`, and the penalties.
Eigen::MatrixXd Fit::inverse_with_penalties(NormalEquations& equations) const {
  const std::vector<double> values = design_->unknown_values();
  for (const PenaltyRow& row : penalty_rows(*design_, smoothness_sigma_))
    equations.add(row, values);
  return ScaledCholesky(equations.information).inverse();
}

// Covariance and effective number of unknowns: what priors and smoothness hold is no unknown, and
// how much that is depends on the variance in turn. Returns JᵀJ in units of that variance.
Eigen::MatrixXd Fit::count_effective_unknowns(const NormalEquations& equations) {
  const Eigen::MatrixXd whole = equations.information.selfadjointView<Eigen::Lower>();
  const double count = static_cast<double>(equations.equations);
  effective_unknowns_ = std::min(static_cast<double>(design_->unknowns()), 0.5 * count);
  Eigen::MatrixXd data;
  for (int pass = 0; pass < kVariancePasses; ++pass) {
    const double variance =
        std::max(equations.cost / std::max(1.0, count - effective_unknowns_), 1e-12);
    data = whole / variance;
    NormalEquations scaled = equations;
    scaled.information /= variance;
    covariance_ = inverse_with_penalties(scaled);
    const double before = std::exchange(effective_unknowns_, covariance_.cwiseProduct(data).sum());
    if (std::abs(before - effective_unknowns_) < kSettled * count) break;
  }
  return data;
}

void Fit::compute_covariance(const EvaluatedRows& evaluated) {
  const Eigen::MatrixXd data = count_effective_unknowns(accumulate(*design_, evaluated));
  table_evidence_ = table_evidence(*design_, data, smoothness_sigma_);
  count_repeats_in_covariance(evaluated);
  learnt_ = what_was_learnt();
}

Eigen::VectorXd Fit::what_was_learnt() const {
  std::vector<int> outside;
  std::vector<double> one_over_prior;
  const std::vector<int>& linear = design_->free_parameters();
  for (int u = 0; u < design_->unknowns(); ++u) {
    if (design_->is_table_unknown(u)) continue;
    const auto at = static_cast<std::size_t>(u);
    const double prior = at < linear.size()
                             ? model_.parameters[static_cast<std::size_t>(linear[at])].prior_sigma
                             : 0.0;
    outside.push_back(u);
    // What has no prior is learnt without limit.
    one_over_prior.push_back(prior > 0.0 ? 1.0 / prior : 0.0);
  }
  const Eigen::Map<const Eigen::VectorXd> scale(one_over_prior.data(),
                                                static_cast<Eigen::Index>(one_over_prior.size()));
  const Eigen::MatrixXd shrunk =
      scale.asDiagonal() * covariance_(outside, outside) * scale.asDiagonal();
  return -symmetric_eigenvalues(shrunk).array().max(kLearntInFull).log();
}

double Fit::charge_for_unknowns(double coordinates) const {
  const double most = std::log(coordinates);
  return table_evidence_.occam + learnt_.array().max(0.0).min(most).sum();
}

// What the shots of one visit share makes coefficients less sure than as many visits would.
void Fit::count_repeats_in_covariance(const EvaluatedRows& evaluated) {
  const std::size_t rows = evaluated.rows.size();
  const Replicates replicates(measurements_, evaluated.index);
  if (!replicates.any()) return;
  const int height = design_->residuals_per_row();
  Eigen::VectorXd residual(static_cast<Eigen::Index>(rows) * height);
  for (std::size_t r = 0; r < rows; ++r) {
    residual.segment(static_cast<Eigen::Index>(r) * height, height) =
        evaluated.rows[r].residual.head(height);
  }
  const double correlation = replicates.correlation(residual, height);
  if (correlation <= 0.0) return;
  const std::vector<double> worth = replicates.worth(correlation);
  NormalEquations equations(design_->unknowns());
  double design_effect = 0.0;
  for (std::size_t r = 0; r < rows; ++r) {
    Design::Row row = evaluated.rows[r];
    row.jacobian *= std::sqrt(worth[r]);
    equations.add(row, height);
    design_effect += 1.0 / worth[r] / static_cast<double>(rows);
  }
  const double freedom =
      std::max(1.0, static_cast<double>(residual.size()) - effective_unknowns_ * design_effect);
  equations.information /= std::max(residual.squaredNorm() / freedom, 1e-12);
  covariance_ = inverse_with_penalties(equations);
}

void Fit::measure_errors() {
  const std::vector<double> distance = residual_distances(*design_);
  std::vector<double> kept;
  for (std::size_t i = 0; i < distance.size(); ++i) {
    if (design_->weights()[i] > 0.0) kept.push_back(distance[i]);
  }
  train_ = summarise(kept);
  for (RejectedRow& r : rejected_) r.residual = distance[r.row];
}

void Fit::measure_held_out_errors(const EvaluatedRows& evaluated) {
  std::vector<std::vector<int>> foldings;
  for (const Folding folding : {Folding::kRandom, Folding::kTime, Folding::kRegion})
    foldings.push_back(make_folds(*design_, folding, options_.folds, options_.seed));
  held_out_distances_ =
      held_out_distances(*design_, evaluated, foldings, options_.folds, smoothness_sigma_);
  held_out_.clear();
  for (const std::vector<double>& distances : held_out_distances_)
    held_out_.push_back(summarise_finite(distances));
}

void Fit::cross_validate() {
  if (options_.cross_validate) return;
  options_.cross_validate = true;
  measure_held_out_errors(evaluate_rows(*design_));
}

void Fit::measure_noise_floor() {
  // Repeats: differences of the residuals of one pose from one visit to the next, so that neither
  // what the model explains (payload, temperature) counts nor what drifts slowly meanwhile.
  std::map<std::pair<int, int>, std::vector<std::size_t>> visits;
  for (std::size_t i = 0; i < measurements_.rows; ++i) {
    if (design_->weights()[i] > 0.0)
      visits[{measurements_.poses.pose_of_row[i], measurements_.target[i]}].push_back(i);
  }
  const bool timed = state().has("time");
  std::vector<double> half_squares;
  for (auto& [id, rows] : visits) {
    if (timed) {
      const std::vector<double>& time = state().column("time");
      std::stable_sort(rows.begin(), rows.end(),
                       [&](std::size_t a, std::size_t b) { return time[a] < time[b]; });
    }
    std::optional<Eigen::Vector3d> before;
    int last_visit = -1;
    for (const std::size_t i : rows) {
      // Of one visit a single reading: the others do not show how the arm repeats.
      if (std::exchange(last_visit, measurements_.poses.visit_of_row[i]) ==
          measurements_.poses.visit_of_row[i])
        continue;
      const Eigen::Vector3d error = design_->predict(i).translation() -
                                    measurements_.position.col(static_cast<Eigen::Index>(i));
      if (before) half_squares.push_back((error - *before).squaredNorm() / 2.0);
      before = error;
    }
  }
  // Visits hours apart differ by what nobody modelled yet; most visits follow each other.
  const double largest =
      half_squares.empty() ? 0.0 : kLargestChiSquared3 * median(half_squares) / kMedianChiSquared3;
  std::erase_if(half_squares, [&](double v) { return v > largest; });
  const double squares = std::accumulate(half_squares.begin(), half_squares.end(), 0.0);
  const std::size_t freedom = 3 * half_squares.size();
  noise_floor_.count = freedom;
  if (freedom >= kLeastFloorFreedom) {
    noise_floor_.mean = kMeanChi3 * std::sqrt(squares / static_cast<double>(freedom));
    // Where every visit was long after the one before, their differences hold what drifted
    // meanwhile. Noise is never more than what the fit leaves.
    const double n = static_cast<double>(train_.count) * design_->residuals_per_row();
    const double left = train_.mean / std::sqrt(std::max(0.2, 1.0 - effective_unknowns_ / n));
    if (noise_floor_.mean > kFloorAboveResidual * left) noise_floor_.mean = left;
    noise_floor_.source = "repeats";
    return;
  }
  if (measurements_.sigma_source != SigmaSource::kAssumed) {
    noise_floor_.mean = kMeanChi3 * measurements_.typical_sigma / noise_scale_;
    noise_floor_.source = "sigma";
    return;
  }
  measure_noise_floor_between_targets();
}

// Reflectors on one rigid tool, measured while the arm stood still: the distance between two is one
// number, and twice the instrument's variance is what it scatters by. The arm's own repeatability
// is not in it.
void Fit::measure_noise_floor_between_targets() {
  std::map<std::vector<double>, std::vector<std::size_t>> standing;
  if (measurements_.targets > 1) {
    const int n = robot().joint_count();
    for (std::size_t i = 0; i < measurements_.rows; ++i) {
      if (design_->weights()[i] == 0.0) continue;
      std::vector<double> q;
      for (int k = 1; k <= n; ++k) q.push_back(state().column("q" + std::to_string(k))[i]);
      standing[q].push_back(i);
    }
  }
  std::map<std::pair<int, int>, std::vector<double>> distances;
  for (const auto& [q, rows] : standing) {
    for (std::size_t a = 0; a < rows.size(); ++a) {
      for (std::size_t b = a + 1; b < rows.size(); ++b) {
        const auto pair = std::minmax(measurements_.target[rows[a]], measurements_.target[rows[b]]);
        if (pair.first == pair.second) continue;
        const auto at = [&](std::size_t i) {
          return measurements_.position.col(static_cast<Eigen::Index>(i));
        };
        distances[{pair.first, pair.second}].push_back((at(rows[a]) - at(rows[b])).norm());
      }
    }
  }
  double squares = 0.0;
  std::size_t freedom = 0;
  for (const auto& [pair, lengths] : distances) {
    const double mean =
        std::accumulate(lengths.begin(), lengths.end(), 0.0) / static_cast<double>(lengths.size());
    for (const double length : lengths) squares += (length - mean) * (length - mean) / 2.0;
    freedom += lengths.size() - 1;
  }
  if (freedom < kLeastFloorFreedom) {
    noise_floor_.mean = std::numeric_limits<double>::quiet_NaN();
    noise_floor_.source = "none";
    return;
  }
  noise_floor_.count = freedom;
  noise_floor_.mean = kMeanChi3 * std::sqrt(squares / static_cast<double>(freedom));
  noise_floor_.source = "targets";
}

json Fit::document() const {
  const int targets = measurements_.targets;
  json document;
  document["measuring_from_base"] = to_json(kinematics_->base());
  json tools = json::object();
  for (int t = 0; t < targets; ++t)
    tools[targets > 1 ? std::to_string(t) : ""] = to_json(kinematics_->tool(t));
  document["flange_from_tool"] = tools;

  std::map<std::string, double> nonlinear;
  for (const NonlinearParameter& p : model_.nonlinear) nonlinear[p.name] = p.value;
  std::vector<std::string> sentence(model_.parameters.size());
  for (const Unidentifiable& held : identifiability_.held)
    sentence[static_cast<std::size_t>(held.parameter)] = held.sentence;
  json parameters = json::array();
  for (std::size_t i = 0; i < model_.parameters.size(); ++i) {
    Parameter p = model_.parameters[i];
    for (Term& term : p.terms) term.basis = term.basis.substitute(nonlinear);
    json entry = armtrue::to_json(p, targets);
    const int unknown = design_->unknown_of(static_cast<int>(i));
    entry["fixed"] = p.fixed;
    entry["held"] = unknown < 0 && !p.fixed;
    entry["sigma"] = unknown >= 0 ? json(std::sqrt(std::max(0.0, covariance_(unknown, unknown))))
                                  : json(nullptr);
    if (unknown >= 0 && !design_->is_table_unknown(unknown)) {
      // The three it moves with most.
      std::vector<std::pair<double, int>> partners;
      for (int u = 0; u < static_cast<int>(design_->free_parameters().size()); ++u) {
        if (u == unknown) continue;
        const double r =
            covariance_(unknown, u) / std::sqrt(covariance_(unknown, unknown) * covariance_(u, u));
        partners.emplace_back(r, u);
      }
      const std::size_t count = std::min<std::size_t>(3, partners.size());
      std::partial_sort(
          partners.begin(), partners.begin() + static_cast<std::ptrdiff_t>(count), partners.end(),
          [](const auto& a, const auto& b) { return std::abs(a.first) > std::abs(b.first); });
      entry["correlations"] = json::array();
      for (std::size_t k = 0; k < count; ++k) {
        const int other = design_->free_parameters()[static_cast<std::size_t>(partners[k].second)];
        entry["correlations"].push_back(
            {{"with", model_.parameters[static_cast<std::size_t>(other)].name},
             {"r", partners[k].first}});
      }
    }
    parameters.push_back(entry);
  }
  document["parameters"] = parameters;
  document["nonlinear"] = json::array();
  for (std::size_t j = 0; j < model_.nonlinear.size(); ++j) {
    const NonlinearParameter& p = model_.nonlinear[j];
    const auto u = static_cast<Eigen::Index>(design_->free_parameters().size() + j);
    document["nonlinear"].push_back({{"name", p.name},
                                     {"effect", p.effect},
                                     {"joints", p.joints},
                                     {"unit", p.unit},
                                     {"value", p.value},
                                     {"sigma", std::sqrt(std::max(0.0, covariance_(u, u)))}});
  }
  document["error"] = {{"nominal", to_json(nominal_)},
                       {"train", to_json(train_)},
                       {"held_out", to_json(held_out_[0])}};
  document["error"]["held_out_by"] =
      document["error"]["cross_validation"] = {{"random", to_json(held_out_[0])},
                                               {"time", to_json(held_out_[1])},
                                               {"region", to_json(held_out_[2])}};
  document["error"]["folds"] = options_.folds;
  document["error"]["seed"] = options_.seed;
  document["noise_floor"] = {
      {"um", std::isfinite(noise_floor_.mean) ? json(noise_floor_.mean * 1e6) : json(nullptr)},
      {"source", noise_floor_.source}};
  document["noise"] = {
      {"sigma_um", measurements_.typical_sigma * 1e6},
      {"stated_sigma_um", measurements_.sigma_source == SigmaSource::kAssumed
                              ? json(nullptr)
                              : json(measurements_.typical_sigma / noise_scale_ * 1e6)},
      {"sigma_rotation_rad",
       measurements_.has_rotation() ? json(measurements_.sigma_rotation) : json(nullptr)}};
  document["smoothness_sigma"] = smoothness_sigma_;
  document["rejected"] = json::array();
  for (const RejectedRow& r : rejected_) {
    document["rejected"].push_back({{"index", r.row}, {"residual_um", r.residual * 1e6}});
  }
  document["unobservable"] = json::array();
  for (const Unidentifiable& held : identifiability_.held)
    document["unobservable"].push_back(held.sentence);
  document["warnings"] = warnings_;
  document["solver"] = {{"iterations", summary_.iterations},
                        {"converged", summary_.converged},
                        {"message", summary_.message}};
  document["effects_move_um"] = json::object();
  for (const auto& [effect, metres] : effect_sizes(*design_))
    document["effects_move_um"][effect] = metres * 1e6;
  document["columns"] = columns_needed(model_, state());
  if (state().recorded("time")) document["time_origin_s"] = state().time_origin();
  document["payload_point"] = {state().payload_point().x(), state().payload_point().y(),
                               state().payload_point().z()};
  return document;
}

}  // namespace armtrue
