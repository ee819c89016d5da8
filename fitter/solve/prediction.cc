#include "fitter/solve/prediction.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <nlohmann/json.hpp>
#include <numeric>
#include <string>
#include <utility>

#include "fitter/design/stance.h"

namespace armtrue {
namespace {

using nlohmann::json;

Pose pose_from(const json& value) {
  const auto p = value.at("xyz").get<std::vector<double>>();
  const auto a = value.at("rpy").get<std::vector<double>>();
  return pose_from_xyz_rpy({p.at(0), p.at(1), p.at(2)}, {a.at(0), a.at(1), a.at(2)});
}

// If the set-up of a row is not recorded, its prediction is in the first set-up's frame.
Model without_unsaid_setups(Model model, const State& state) {
  const int joints = state.robot().joint_count();
  std::erase_if(model.parameters, [&](const Parameter& p) {
    return !p.exported && std::ranges::any_of(p.terms, [&](const Term& term) {
      return std::ranges::any_of(term.basis.variables(), [&](const std::string& name) {
        const auto v = parse_variable(name, joints);
        return v && v->kind == VariableKind::kColumn && !state.has(name);
      });
    });
  });
  return model;
}

Model predicted_part(const Model& model, const State& state) {
  Model part = without_unsaid_setups(model, state);
  const int joints = state.robot().joint_count();
  std::erase_if(part.parameters, [&](const Parameter& p) { return !is_foreseeable(p, joints); });
  return part;
}

bool any_reads_point(const Model& model) {
  return std::ranges::any_of(model.parameters, &reads_point);
}

Model without_reading_point(Model model) {
  std::erase_if(model.parameters, &reads_point);
  return model;
}

// Errors of the instrument depend on where it sees the reflector. A prediction takes that point
// from the predicted arm, not from measured columns that the file may have.
State::Columns with_points(State::Columns columns, const std::vector<Pose>& poses) {
  put_poses(poses, false, columns);
  return columns;
}

// Rows to be predicted, as input of a Design: measured positions are 0, residuals in metres.
Measurements unmeasured(std::size_t rows, const std::vector<int>& target, int targets) {
  Measurements measurements;
  measurements.rows = rows;
  measurements.position = Eigen::Matrix3Xd::Zero(3, static_cast<Eigen::Index>(rows));
  measurements.target = target;
  measurements.targets = targets;
  measurements.whiten_position.assign(rows, Eigen::Matrix3d::Identity());
  return measurements;
}

// For each unknown of `part`, its index among those of `whole`.
std::vector<Eigen::Index> places_in(const Design& whole, const Design& part) {
  std::vector<Eigen::Index> places;
  for (const int free : part.free_parameters()) {
    const Parameter& p = part.model().parameters[static_cast<std::size_t>(free)];
    places.push_back(whole.unknown_of(whole.model().index(p.name)));
  }
  const auto linear = static_cast<Eigen::Index>(whole.free_parameters().size());
  for (int j = 0; j < part.nonlinear_count(); ++j) places.push_back(linear + j);
  return places;
}

// Parameters that no prediction contains, with their bases replaced by constants: the root mean
// square over the measurements. Like the measured poses, a new one has an unknown history.
struct Unforeseen {
  Model model;
  Eigen::VectorXd values;       // fitted; zero in `model`
  Eigen::MatrixXd correlation;  // of the parameters' bases over the measurements
};

Unforeseen unforeseen_part(const Fit& fit) {
  Unforeseen part;
  const auto rows = static_cast<Eigen::Index>(fit.state().rows());
  Eigen::MatrixXd courses(rows, 0);
  for (Parameter p : fit.model().parameters) {
    if (p.terms.empty() || is_foreseeable(p, fit.robot().joint_count())) continue;
    const auto basis_of = [&](const Term& term) -> Eigen::VectorXd {
      return Eigen::VectorXd::Map(fit.state().values(term.basis).data(), rows);
    };
    Eigen::VectorXd course = basis_of(p.terms.front());
    course *= std::sqrt(static_cast<double>(rows)) / std::max(course.norm(), 1e-300);
    for (Term& term : p.terms)
      term.basis = Expression::number(basis_of(term).dot(course) / static_cast<double>(rows));
    p.fixed = false;
    const Eigen::Index count = courses.cols() + 1;
    part.values.conservativeResize(count);
    part.values[count - 1] = std::exchange(p.value, 0.0);
    part.model.parameters.push_back(std::move(p));
    courses.conservativeResize(Eigen::NoChange, count);
    courses.rightCols<1>() = course;
  }
  part.correlation = courses.transpose() * courses / static_cast<double>(rows);
  return part;
}

// Covariance of products of coefficient and basis, both uncertain, in units of the bases' root mean
// squares. `covariance`: of the fit's unknowns, among which the parameters have `places`, or −1 if
// they are held.
Eigen::MatrixXd spread_of(const Unforeseen& part, const Eigen::MatrixXd& covariance,
                          const std::vector<Eigen::Index>& places) {
  Eigen::MatrixXd spread = part.values * part.values.transpose();
  for (Eigen::Index i = 0; i < spread.rows(); ++i) {
    for (Eigen::Index j = 0; j < spread.cols(); ++j) {
      const Eigen::Index a = places[static_cast<std::size_t>(i)];
      const Eigen::Index b = places[static_cast<std::size_t>(j)];
      if (a >= 0 && b >= 0) spread(i, j) += covariance(a, b);
    }
  }
  return spread.cwiseProduct(part.correlation);
}

// Covariance of the predicted position of row `i` due to that of the unknowns, which has those of
// `design` in `places`.
Eigen::Matrix3d propagated(Design& design, std::size_t i, const Eigen::MatrixXd& covariance,
                           const std::vector<Eigen::Index>& places) {
  Design::Row row;
  design.evaluate(i, true, row);
  std::vector<Eigen::Index> touched;
  for (const int unknown : row.unknowns)
    touched.push_back(places[static_cast<std::size_t>(unknown)]);
  const Eigen::Matrix3Xd jacobian = row.jacobian.topRows<3>();
  return jacobian * covariance(touched, touched) * jacobian.transpose();
}

// What the tables of one variable would add beyond their nodes, where their hats are zero but the
// error that they stand for is not known to be: one coefficient a table, as large as its nodes.
struct BeyondTables {
  Model model;
  Eigen::MatrixXd covariance;
};

// 0 between the first and the last node; beyond them it rises to 1 over the width of one cell,
// where the last hat function has become zero.
Expression beyond_nodes(const TableReference::Axis& axis) {
  const auto text = [](double v) { return Expression::number(v).to_string(); };
  const std::size_t last = axis.nodes.size() - 1;
  const std::string& q = axis.variable;
  const double below = axis.nodes[1] - axis.nodes[0];
  const double above = axis.nodes[last] - axis.nodes[last - 1];
  return Expression::parse("min(1, max(0, (" + text(axis.nodes.front()) + " - " + q + ")/" +
                           text(below) + ") + max(0, (" + q + " - " + text(axis.nodes.back()) +
                           ")/" + text(above) + "))");
}

BeyondTables beyond_tables(const Fit& fit) {
  BeyondTables beyond;
  std::vector<double> squares, counts;
  std::map<std::string, std::size_t> of_table;  // by its id
  for (const Parameter& node : fit.model().parameters) {
    if (node.terms.size() != 1 || !node.terms.front().table) continue;
    const TableReference& table = *node.terms.front().table;
    if (table.axes.size() != 1 || table.axes.front().nodes.size() < 2) continue;
    const auto [at, fresh] = of_table.try_emplace(table.id, squares.size());
    if (fresh) {
      Parameter p = node;
      p.name += ".beyond";
      p.value = 0.0;
      p.fixed = false;
      p.terms.front().basis = beyond_nodes(table.axes.front());
      p.terms.front().table.reset();
      beyond.model.parameters.push_back(std::move(p));
      squares.push_back(0.0);
      counts.push_back(0.0);
    }
    squares[at->second] += node.value * node.value;
    counts[at->second] += 1.0;
  }
  const auto count = static_cast<Eigen::Index>(squares.size());
  const Eigen::ArrayXd sums = Eigen::ArrayXd::Map(squares.data(), count);
  beyond.covariance = (sums / Eigen::ArrayXd::Map(counts.data(), count)).matrix().asDiagonal();
  return beyond;
}

std::vector<Eigen::Index> in_order(const Model& model) {
  std::vector<Eigen::Index> places(model.parameters.size());
  std::iota(places.begin(), places.end(), 0);
  return places;
}

// Standard deviation of a parameter that has no prior [m or rad].
constexpr double kNoPriorSigma = 1.0;

Model with_priors(Model model, const std::vector<Unidentifiable>& held) {
  for (const Unidentifiable& h : held) {
    double& sigma = model.parameters[static_cast<std::size_t>(h.parameter)].prior_sigma;
    if (sigma <= 0.0) sigma = kNoPriorSigma;
  }
  return model;
}

}  // namespace

void put_poses(const std::vector<Pose>& poses, bool orientation, State::Columns& columns) {
  for (const char* name : {"x", "y", "z", "qw", "qx", "qy", "qz"}) columns.erase(name);
  for (const Pose& pose : poses) {
    columns["x"].push_back(pose.translation().x());
    columns["y"].push_back(pose.translation().y());
    columns["z"].push_back(pose.translation().z());
    if (!orientation) continue;
    const Eigen::Quaterniond q(pose.linear());
    columns["qw"].push_back(q.w());
    columns["qx"].push_back(q.x());
    columns["qy"].push_back(q.y());
    columns["qz"].push_back(q.z());
  }
}

FittedModel FittedModel::from_json(const json& document) {
  FittedModel fitted;
  fitted.robot = Robot::from_json(document.at("robot"));
  fitted.measuring_from_base = pose_from(document.at("measuring_from_base"));
  for (const auto& [name, pose] : document.at("flange_from_tool").items()) {
    fitted.targets.push_back(name);
    fitted.flange_from_tool.push_back(pose_from(pose));
  }
  const int targets = static_cast<int>(fitted.targets.size());
  for (const json& entry : document.at("parameters")) {
    Parameter p;
    entry.at("name").get_to(p.name);
    entry.at("effect").get_to(p.effect);
    p.joints = entry.value("joints", std::vector<int>{});
    p.unit = entry.value("unit", "");
    entry.at("value").get_to(p.value);
    p.exported = entry.value("exported", true);
    for (const json& term : entry.at("terms")) {
      p.terms.push_back(term_from_json(term, fitted.robot.joint_count(), targets));
    }
    if (p.value != 0.0 && is_foreseeable(p, fitted.robot.joint_count()))
      fitted.model.parameters.push_back(std::move(p));
  }
  if (document.contains("first_from_set_up")) {
    for (const auto& [number, pose] : document["first_from_set_up"].items())
      fitted.first_from_set_up.emplace(std::stoi(number), pose_from(pose));
  }
  if (document.contains("payload_point")) {
    const auto point = document["payload_point"].get<std::vector<double>>();
    fitted.robot.payload_point = Eigen::Vector3d(point.at(0), point.at(1), point.at(2));
  }
  fitted.time_origin = document.value("time_origin_s", 0.0);
  fitted.loads_follow = document.value("statics", "deflected") != "nominal";
  return fitted;
}

std::vector<Pose> FittedModel::predict(const State::Columns& columns,
                                       const std::vector<int>& target) const {
  Kinematics kinematics(robot, static_cast<int>(flange_from_tool.size()));
  kinematics.set_base(measuring_from_base);
  for (std::size_t t = 0; t < flange_from_tool.size(); ++t)
    kinematics.set_tool(static_cast<int>(t), flange_from_tool[t]);
  const auto poses_of = [&](const Model& part, const State::Columns& given) {
    State state(robot, given, robot.payload_point.value_or(Eigen::Vector3d::Zero()));
    state.begin_time_at(time_origin);
    state.let_loads_follow(loads_follow);
    const Model told = without_unsaid_setups(part, state);
    stand(state, told, kinematics);
    return predict_poses(state, target, told, kinematics);
  };
  std::vector<Pose> poses = poses_of(without_reading_point(model), columns);
  if (any_reads_point(model)) poses = poses_of(model, with_points(columns, poses));
  for (std::size_t i = 0; i < poses.size(); ++i) {
    if (const Pose* first_from_own = set_up_of(first_from_set_up, columns, i))
      poses[i] = first_from_own->inverse() * poses[i];
  }
  return poses;
}

FreedFit::FreedFit(const Fit& fit)
    : state(fit.state()),
      model(with_priors(fit.model(), fit.identifiability().held)),
      design(state, fit.measurements(), model, fit.kinematics()) {
  design.weights() = fit.design().weights();
  design.stand(state);
}

std::vector<Eigen::Matrix3d> predicted_position_covariance(const Fit& fit,
                                                           const State::Columns& columns,
                                                           const std::vector<int>& target) {
  const auto state_of = [&](const State::Columns& given) {
    State state(fit.robot(), given, fit.state().payload_point());
    state.begin_time_at(fit.state().time_origin());
    state.let_loads_follow(fit.state().loads_follow());
    return state;
  };
  State state = state_of(columns);
  const Model part = predicted_part(fit.model(), state);
  const Measurements rows = unmeasured(state.rows(), target, fit.measurements().targets);
  if (any_reads_point(part)) {
    const Model arm = without_reading_point(part);
    Design of_arm(state, rows, arm, fit.kinematics());
    of_arm.stand(state);
    std::vector<Pose> poses;
    for (std::size_t i = 0; i < state.rows(); ++i) poses.push_back(of_arm.predict(i));
    state = state_of(with_points(columns, poses));
  }
  Design design(state, rows, part, fit.kinematics());
  design.stand(state);
  FreedFit whole(fit);
  const std::vector<Eigen::Index> places = places_in(whole.design, design);
  const Eigen::MatrixXd covariance =
      covariance_of(whole.design, fit.smoothness_sigma(), fit.effective_unknowns());
  const Unforeseen unforeseen = unforeseen_part(fit);
  Design of_history(state, rows, unforeseen.model, fit.kinematics());
  const Eigen::MatrixXd by_history =
      spread_of(unforeseen, covariance, places_in(whole.design, of_history));
  const BeyondTables beyond = beyond_tables(fit);
  Design of_beyond(state, rows, beyond.model, fit.kinematics());
  std::vector<Eigen::Matrix3d> covariances;
  covariances.reserve(state.rows());
  for (std::size_t i = 0; i < state.rows(); ++i) {
    Eigen::Matrix3d own = propagated(design, i, covariance, places);
    if (!of_history.model().parameters.empty())
      own += propagated(of_history, i, by_history, in_order(unforeseen.model));
    if (!of_beyond.model().parameters.empty())
      own += propagated(of_beyond, i, beyond.covariance, in_order(beyond.model));
    if (const Pose* first_from_own = set_up_of(fit.first_from_set_up(), columns, i)) {
      const Eigen::Matrix3d turn = first_from_own->linear().transpose();
      own = turn * own * turn.transpose();
    }
    covariances.push_back(own);
  }
  return covariances;
}

}  // namespace armtrue
