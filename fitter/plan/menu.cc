#include "fitter/plan/menu.h"

#include <algorithm>

#include "fitter/common/statistics.h"
#include "fitter/plan/exchange.h"

namespace armtrue {
namespace {

// More distinct values than this are a measured quantity, not a choice of a few.
constexpr std::size_t kFewLevels = 6;

}  // namespace

std::set<std::string> settable_columns(const Model& model, const State& state) {
  std::set<std::string> columns;
  for (const Parameter& p : model.parameters) {
    for (const Term& term : p.terms) {
      for (const std::string& name : term.basis.variables()) {
        const auto variable = parse_variable(name, state.robot().joint_count());
        if (!variable || variable->kind == VariableKind::kReadBack) continue;
        for (const std::string& column :
             columns_of(*variable, state.robot(), state.recorded("payload"))) {
          const auto read = parse_variable(column, state.robot().joint_count());
          // A torque is measured, never set.
          const bool is_torque = read && read->kind == VariableKind::kTorque;
          if (!is_torque && state.recorded(column)) columns.insert(column);
        }
      }
    }
  }
  return columns;
}

Levels recorded_levels(const State& state, const std::set<std::string>& columns) {
  Levels levels;
  for (const std::string& name : columns) {
    const auto variable = parse_variable(name, state.robot().joint_count());
    if (variable && variable->kind == VariableKind::kDirection) {
      levels[name] = {-1.0, 1.0};
      continue;
    }
    const std::vector<double>& values = state.column(name);
    const std::set<double> different(values.begin(), values.end());
    if (different.size() <= kFewLevels) {
      levels[name].assign(different.begin(), different.end());
    } else {
      levels[name] = {*different.begin(), median(values), *different.rbegin()};
    }
  }
  return levels;
}

Menu make_menu(const Robot& robot, const Pose& flange_from_tool, const Cell& cell,
               const Eigen::MatrixX2d& ranges, const Levels& levels, std::size_t count,
               std::uint64_t seed) {
  Menu menu;
  menu.uniform = (count + 1) / 2;
  const auto even =
      reachable_poses(robot, flange_from_tool, cell, ranges, Spread::kUniform, menu.uniform, seed);
  const auto edges = reachable_poses(robot, flange_from_tool, cell, ranges, Spread::kEdges,
                                     count - menu.uniform, seed + 1);
  for (int k = 0; k < robot.joint_count(); ++k) {
    const std::string name = "q" + std::to_string(k + 1);
    std::vector<double>& column = menu.columns[name];
    column.assign(even.col(k).begin(), even.col(k).end());
    column.insert(column.end(), edges.col(k).begin(), edges.col(k).end());
    if (robot.is_passive(k + 1)) continue;
    menu.columns["qr" + std::to_string(k + 1)] = column;
    menu.written.push_back(name);
  }
  std::mt19937_64 generator(seed + 2);
  for (const auto& [name, values] : levels) {
    if (values.empty())
      throw ModelError("plan: column " + name + " has no levels, expected at least one");
    std::vector<double>& column = menu.columns[name];
    column.clear();
    for (std::size_t row = 0; row < count; ++row) {
      column.push_back(values[generator() % values.size()]);
    }
    menu.written.push_back(name);
  }
  return menu;
}

}  // namespace armtrue
