#include "fitter/plan/plan.h"

#include <algorithm>
#include <functional>
#include <limits>
#include <nlohmann/json.hpp>

#include "fitter/common/statistics.h"
#include "fitter/diagnose/diagnose.h"
#include "fitter/plan/rivals.h"
#include "fitter/solve/information.h"
#include "fitter/solve/prediction.h"

namespace armtrue {
namespace {

using nlohmann::json;

constexpr std::size_t kMostPoses = 2000;
constexpr std::size_t kMostCandidates = 50000;
// Smoothness of tables before data determine one: the fit's own default.
constexpr double kSmoothness = 1e-4;
// ΔBIC that settles a question: "very strong" evidence (Kass and Raftery 1995).
constexpr double kTold = 10.0;
// Random choices for which a rival that bends is fitted again.
constexpr std::size_t kRefits = 5;

std::function<void(double)> stage(Observer& observer, double from, double to, const char* what) {
  return [&observer, from, to, what](double share) {
    observer.report(from + share * (to - from), what);
  };
}

PlannedRows take(const Menu& menu, const Robot& robot, const std::vector<std::size_t>& chosen) {
  PlannedRows rows{menu.written, {}};
  for (const std::size_t row : run_order(menu, robot, chosen)) {
    for (const std::string& name : menu.written)
      rows.columns[name].push_back(menu.columns.at(name)[row]);
  }
  return rows;
}

json rows_json(const PlannedRows& rows) {
  json columns = json::object();
  for (const std::string& name : rows.written) columns[name] = rows.columns.at(name);
  return {{"written", rows.written}, {"columns", columns}};
}

// Levels of all columns that the models read: as given, else as recorded.
Levels levels_for(const std::vector<const Fit*>& fits, const Levels& given) {
  std::set<std::string> columns;
  for (const Fit* fit : fits) columns.merge(settable_columns(fit->model(), fit->state()));
  const State& state = fits.front()->state();
  if (state.recorded("payload")) columns.insert("payload");
  Levels levels = recorded_levels(state, columns);
  for (const auto& [name, values] : given) levels[name] = values;
  return levels;
}

Menu menu_for(const Fit& fit, const Levels& levels, const PlanOptions& options) {
  Menu menu = make_menu(fit.robot(), fit.kinematics().tool(0), options.cell,
                        joint_ranges(fit.robot(), fit.state().joints()), levels, options.candidates,
                        options.seed);
  // Errors of the instrument depend on where it sees the reflector. The nominal arm, accurate to a
  // millimetre, predicts that well enough.
  const State state(fit.robot(), menu.columns, fit.state().payload_point());
  const std::vector<int> target(state.rows(), 0);
  put_poses(predict_poses(state, target, Model{}, fit.kinematics()), false, menu.columns);
  return menu;
}

// The session in which `poses` measurements, chosen greedily, are worth most.
std::vector<bool> best_session(const Menu& menu, const Criterion& start, std::size_t poses) {
  std::vector<std::vector<bool>> all = sessions(menu);
  std::erase_if(all, [&](const std::vector<bool>& session) {
    return std::count(session.begin(), session.end(), true) < static_cast<std::ptrdiff_t>(poses);
  });
  if (all.empty()) {
    throw ModelError(
        "plan: too few candidates fit one session, with time going forward and no temperature "
        "coming back; expected more candidates, or fewer levels of temperature and time");
  }
  if (all.size() == 1) return std::move(all.front());
  double most = -std::numeric_limits<double>::infinity();
  std::vector<bool>* best = &all.front();
  for (std::vector<bool>& session : all) {
    Criterion trial = start;
    choose_greedily(trial, poses, session);
    if (trial.value() <= most) continue;
    most = trial.value();
    best = &session;
  }
  return std::move(*best);
}

// Several random choices of a session's rows, among those spread evenly over the reachable poses.
std::vector<std::vector<std::size_t>> random_choices(const Menu& menu,
                                                     const std::vector<bool>& session,
                                                     const PlanOptions& options) {
  std::vector<std::size_t> even;
  for (std::size_t row = 0; row < menu.uniform; ++row) {
    if (session[row]) even.push_back(row);
  }
  std::mt19937_64 generator(options.seed + 3);
  std::vector<std::vector<std::size_t>> draws;
  for (std::size_t draw = 0; draw < options.random_draws; ++draw) {
    draws.push_back(choose_random(even.size(), options.poses, generator));
    for (std::size_t& row : draws.back()) row = even[row];
  }
  return draws;
}

// D-optimal choice from `linearised`, and random choices of as many poses for comparison.
CampaignPlan choose(const Linearised& linearised, const Menu& menu, const Robot& robot,
                    const Eigen::MatrixXd& start, double sigma, const PlanOptions& options,
                    Observer& observer) {
  CampaignPlan plan;
  plan.unknowns = linearised.unknowns();
  Criterion criterion(MeasurementChoice(linearised.jacobian(), linearised.height(), start));
  const std::vector<bool> session = best_session(menu, criterion, options.poses);
  const std::vector<std::size_t> chosen =
      choose_best(criterion, options.poses, session, stage(observer, 0.2, 0.9, "choosing poses"));
  const auto known_with = [&](const std::vector<std::size_t>& rows) -> Eigen::MatrixXd {
    return start + linearised.information_of(rows);
  };
  plan.planned = fisher_spectrum(linearised, known_with(chosen), sigma, menu.uniform);
  observer.report(0.9, "comparing with random poses");
  std::vector<std::pair<double, std::vector<std::size_t>>> draws;
  for (std::vector<std::size_t>& rows : random_choices(menu, session, options)) {
    const double worth = ScaledCholesky(known_with(rows)).log_determinant();
    draws.emplace_back(worth, std::move(rows));
  }
  std::sort(draws.begin(), draws.end());
  plan.random =
      fisher_spectrum(linearised, known_with(draws[draws.size() / 2].second), sigma, menu.uniform);
  plan.rows = take(menu, robot, chosen);
  return plan;
}

// Free parameters without those that no pose of the menu separates from another.
std::vector<int> told_by_any_pose(Design& menu) {
  std::vector<int> told = menu.free_parameters();
  for (const Unidentifiable& held : identify(menu).held) {
    if (held.exact) std::erase(told, held.parameter);
  }
  return told;
}

// Pairs that so many poses of the menu can separate; all pairs if there are none.
std::vector<RivalPair> separable_pairs(const Rivals& rivals, const Menu& menu,
                                       const PlanOptions& options, Observer& observer) {
  std::vector<RivalPair> separable;
  for (const RivalPair& pair : rivals.pairs()) {
    Criterion alone(std::vector{rivals.choice(pair)});
    const std::vector<std::size_t> rows =
        choose_greedily(alone, options.poses, best_session(menu, alone, options.poses));
    if (rivals.evidence(pair, rows) < -kTold) separable.push_back(pair);
    observer.report(0.4, "finding what can be told apart");
  }
  return separable.empty() ? rivals.pairs() : separable;
}

}  // namespace

PlanOptions PlanOptions::from_json(const json& content) {
  PlanOptions options;
  options.poses = content.value("poses", options.poses);
  options.candidates = content.value("candidates", options.candidates);
  options.seed = content.value("seed", options.seed);
  options.cell = Cell::from_json(content);
  options.levels = content.value("levels", Levels{});
  options.random_draws =
      std::max<std::size_t>(1, content.value("random_draws", options.random_draws));
  if (content.contains("instrument") && !content["instrument"].is_null()) {
    options.instrument = Instrument::from_json(content["instrument"]);
  }
  options.assumed_sigma = content.value("assumed_sigma_m", options.assumed_sigma);
  options.sigma_rotation = content.value("sigma_rotation_rad", options.sigma_rotation);
  options.orientation = content.value("orientation", options.orientation);
  if (content.contains("tool")) {
    const auto tool = content["tool"].get<std::vector<double>>();
    options.tool = Eigen::Vector3d(tool.at(0), tool.at(1), tool.at(2));
  }
  if (options.poses < 1 || options.poses > kMostPoses) {
    throw ModelError("plan: poses is " + std::to_string(options.poses) + ", expected 1 to " +
                     std::to_string(kMostPoses));
  }
  if (options.candidates < 2 * options.poses || options.candidates > kMostCandidates) {
    throw ModelError("plan: " + std::to_string(options.candidates) +
                     " candidates to choose from, expected at least twice the " +
                     "poses and at most " + std::to_string(kMostCandidates));
  }
  return options;
}

CampaignPlan plan_campaign(const Robot& given, const ModelSpecification& specification,
                           const PlanOptions& options, Observer& observer) {
  Robot robot = given;
  if (options.tool) {
    Pose tool = Pose::Identity();
    tool.translation() = *options.tool;
    robot.flange_from_tool = tool;
  }
  if (!robot.flange_from_tool) {
    throw ModelError(
        "plan: robot.yaml has no tool, expected where the reflector will sit in the flange");
  }
  observer.report(0.0, "finding reachable poses");
  Menu menu = make_menu(robot, *robot.flange_from_tool, options.cell, joint_ranges(robot, {}),
                        options.levels, options.candidates, options.seed);
  const Eigen::Vector3d point = robot.flange_from_tool->translation();
  Kinematics kinematics(robot, 1);
  kinematics.set_base(robot.measuring_from_base.value_or(Pose::Identity()));
  kinematics.set_tool(0, *robot.flange_from_tool);
  observer.report(0.1, "linearising the model");
  const State joints(robot, menu.columns, point);
  const std::vector<Pose> poses =
      predict_poses(joints, std::vector<int>(joints.rows(), 0), Model{}, kinematics);
  State::Columns columns = menu.columns;
  put_poses(poses, options.orientation, columns);
  const State state(robot, std::move(columns), point);
  const Measurements measurements = Measurements::from_state(
      state, options.instrument, options.assumed_sigma, options.sigma_rotation);
  const EffectContext context{state, 1, {options.orientation}, specification.priors};
  const Model model = build_model(specification, context);
  Design design(state, measurements, model, kinematics);
  const Identifiability identifiable = identify(design);
  design.set_free(identifiable.kept);
  const Linearised linearised(design, kSmoothness);
  CampaignPlan plan = choose(linearised, menu, robot, linearised.known(),
                             measurements.typical_sigma, options, observer);
  for (const Unidentifiable& held : identifiable.held) {
    if (held.exact) {
      ++plan.same_numbers;
    } else {
      plan.weak.push_back(held.sentence);
    }
  }
  observer.report(1.0, "done");
  return plan;
}

CampaignPlan plan_sharpening(Fit& fit, const PlanOptions& options, Observer& observer) {
  observer.report(0.0, "finding reachable poses");
  const Menu menu = menu_for(fit, levels_for({&fit}, options.levels), options);
  observer.report(0.1, "linearising the model");
  const State state(fit.robot(), menu.columns, fit.state().payload_point());
  const Measurements measurements = expected_measurements(
      fit, predict_poses(state, std::vector<int>(state.rows(), 0), fit.model(), fit.kinematics()));
  FreedFit whole(fit);
  Design design(state, measurements, whole.model, fit.kinematics());
  const std::vector<int> told = told_by_any_pose(design);
  design.set_free(told);
  whole.design.set_free(told);
  const Linearised linearised(design, fit.smoothness_sigma());
  const Eigen::MatrixXd taken = linearised.jacobian_of(whole.design);
  const Eigen::MatrixXd start = linearised.known() + taken.transpose() * taken;
  CampaignPlan plan =
      choose(linearised, menu, fit.robot(), start, measurements.typical_sigma, options, observer);
  plan.present = fisher_spectrum(linearised, start, measurements.typical_sigma, menu.uniform);
  observer.report(1.0, "done");
  return plan;
}

std::vector<std::optional<Evidence>> evidence_of(Fit& fit,
                                                 const std::vector<EffectRequest>& effects) {
  const double coordinates =
      static_cast<double>(fit.design().rows()) * fit.design().residuals_per_row();
  const double charge = fit.charge_for_unknowns(coordinates);
  const double bic = bayesian_information(fit);
  std::vector<std::optional<Evidence>> result;
  for (const EffectRequest& effect : effects) {
    try {
      const std::unique_ptr<Fit> with = refit(fit, with_effect(fit.specification(), effect));
      const double change = bayesian_information(*with) - bic;
      result.push_back(
          Evidence{change, change - (with->charge_for_unknowns(coordinates) - charge)});
    } catch (const ModelError&) {
      result.emplace_back();
    }
  }
  return result;
}

SeparationPlan plan_separation(Fit& fit, const std::vector<EffectRequest>& requests,
                               const PlanOptions& options, Observer& observer) {
  if (requests.size() < 2)
    throw ModelError("plan: found fewer than two candidates, expected those to tell apart");
  observer.report(0.0, "fitting the candidates");
  std::vector<std::unique_ptr<Fit>> fits;
  std::vector<const Fit*> views;
  std::vector<double> bic;
  SeparationPlan plan;
  for (const EffectRequest& request : requests) {
    fits.push_back(refit(fit, with_effect(fit.specification(), request)));
    views.push_back(fits.back().get());
    bic.push_back(bayesian_information(*fits.back()));
    plan.candidates.push_back(label(request));
  }
  observer.report(0.2, "finding reachable poses");
  const Menu menu = menu_for(fit, levels_for(views, options.levels), options);
  const Rivals rivals(std::move(fits), menu);
  std::vector<MeasurementChoice> counted;
  for (const RivalPair& pair : separable_pairs(rivals, menu, options, observer)) {
    counted.push_back(rivals.choice(pair));
  }
  Criterion criterion(std::move(counted));
  const std::vector<bool> session = best_session(menu, criterion, options.poses);
  const std::vector<std::size_t> chosen =
      choose_best(criterion, options.poses, session, stage(observer, 0.5, 0.95, "choosing poses"));
  observer.report(0.95, "comparing with random poses");
  const std::vector<std::vector<std::size_t>> draws = random_choices(menu, session, options);
  for (const RivalPair& pair : rivals.pairs()) {
    std::vector<double> random;
    for (const std::vector<std::size_t>& rows : draws) {
      if (rivals.bends(pair) && random.size() >= kRefits) break;
      random.push_back(rivals.evidence(pair, rows));
    }
    const Separation s{pair.truth, pair.rival, bic[pair.truth] - bic[pair.rival],
                       rivals.evidence(pair, chosen), median(random)};
    plan.separations.push_back(s);
  }
  plan.rows = take(menu, fit.robot(), chosen);
  observer.report(1.0, "done");
  return plan;
}

json CampaignPlan::to_json() const {
  json result = rows_json(rows);
  result["unknowns"] = unknowns;
  result["weak"] = weak;
  result["same_numbers"] = same_numbers;
  result["information"] = {{"present", present ? armtrue::to_json(*present) : json(nullptr)},
                           {"planned", armtrue::to_json(planned)},
                           {"random", armtrue::to_json(random)}};
  return result;
}

json SeparationPlan::to_json() const {
  json result = rows_json(rows);
  result["candidates"] = candidates;
  result["separations"] = json::array();
  for (const Separation& s : separations) {
    result["separations"].push_back({{"truth", candidates[s.truth]},
                                     {"rival", candidates[s.rival]},
                                     {"delta_bic_now", s.present},
                                     {"delta_bic_expected", s.planned},
                                     {"delta_bic_expected_random", s.random}});
  }
  return result;
}

}  // namespace armtrue
