// Start of a fit at the result of another one.
#include <algorithm>
#include <cmath>
#include <iterator>

#include "fitter/solve/fit.h"

namespace armtrue {
namespace {

// The 1-D table that a parameter is a node of; nullptr for others.
const TableReference* table_of(const Parameter& p) {
  if (p.terms.empty() || !p.terms.front().table || p.terms.front().table->axes.size() != 1)
    return nullptr;
  return &*p.terms.front().table;
}

double node_of(const TableReference& table) {
  return table.axes.front().nodes[static_cast<std::size_t>(table.index.front())];
}

// A table's value at `node`: linear between its nodes, constant beyond them.
double between(const std::map<double, double>& values, double node) {
  const auto above = values.lower_bound(node);
  if (above == values.end()) return values.rbegin()->second;
  if (above == values.begin()) return above->second;
  const auto below = std::prev(above);
  const double share = (node - below->first) / (above->first - below->first);
  return below->second + share * (above->second - below->second);
}

// Largest change of a spring between two fits of one model, relative to the largest spring.
double largest_change(const std::vector<Spring>& before, const std::vector<Spring>& after) {
  if (before.size() != after.size()) return 1.0;
  double change = 0.0, largest = 0.0;
  for (std::size_t i = 0; i < after.size(); ++i) {
    change = std::max(change, std::abs(after[i].compliance - before[i].compliance));
    largest = std::max(largest, std::abs(after[i].compliance));
  }
  return largest > 0.0 ? change / largest : 0.0;
}

// Largest change of a carried load between two fits of one model, relative to the load.
double largest_change(const std::map<std::string, Expression>& before, const Fit& after) {
  double change = 0.0;
  for (const auto& [load, now] : after.context().carried) {
    const auto found = before.find(load);
    if (found == before.end()) return 1.0;
    const std::vector<double> was = after.state().values(found->second);
    const std::vector<double> is = after.state().values(now);
    double moved = 0.0, whole = 0.0;
    for (std::size_t i = 0; i < is.size(); ++i) {
      moved += (is[i] - was[i]) * (is[i] - was[i]);
      whole += is[i] * is[i];
    }
    if (whole > 0.0) change = std::max(change, std::sqrt(moved / whole));
  }
  return change;
}

}  // namespace

double Fit::change_since(const StartPoint& start) const {
  return std::max(largest_change(start.springs, context_->springs),
                  largest_change(start.carried, *this));
}

StartPoint Fit::start_point() const {
  StartPoint start{prepared_,         {},    kinematics_->base(), {}, context_->springs,
                   context_->carried, state_};
  if (has_tables(model_)) start.smoothness = smoothness_;
  start.orientation_inflation = orientation_inflation_;
  start.noise_scale = noise_scale_;
  start.sigma_rotation = measurements_.sigma_rotation;
  start.weights = design_->weights();
  start.effective_unknowns = effective_unknowns();
  start.unknowns_beside_tables = design_->unknowns_beside_tables();
  for (const Parameter& p : model_.parameters) {
    start.values[p.name] = p.value;
    const TableReference* table = table_of(p);
    if (table) start.tables[table->id][node_of(*table)] = p.value;
  }
  for (int t = 0; t < measurements_.targets; ++t)
    start.flange_from_tool.push_back(kinematics_->tool(t));
  return start;
}

// Sets free parameters to another fit's values; corrections that it folded into base and tool are
// unfolded.
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
    } else if (const TableReference* table = table_of(p);
               table && start.tables.contains(table->id)) {
      value = between(start.tables.at(table->id), node_of(*table));
    } else if (const auto at = start.values.find(p.name); at != start.values.end()) {
      value = at->second;
    }
  }
  design_->set_values(values);
}

}  // namespace armtrue
