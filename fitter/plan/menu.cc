#include "fitter/plan/menu.h"

#include <algorithm>

#include "fitter/plan/exchange.h"
#include "fitter/solve/statistics.h"

namespace armtrue {
namespace {

// More different values than this are a measured quantity, not a choice of a few.
constexpr std::size_t kFewLevels = 6;

bool is_numbered(const std::string& name, const std::string& prefix) {
  return name.size() > prefix.size() && name.starts_with(prefix) &&
         std::all_of(name.begin() + static_cast<std::ptrdiff_t>(prefix.size()), name.end(),
                     [](char c) { return c >= '0' && c <= '9'; });
}

bool reads_gravity(const std::string& variable) {
  for (const char* prefix : {"tau", "gmx", "gmy"}) {
    if (is_numbered(variable, prefix)) return true;
  }
  return variable == "bmx" || variable == "bmy" || variable.starts_with("up") ||
         variable.starts_with("u_") || variable.starts_with("ux_") || variable.starts_with("uy_");
}

}  // namespace

std::set<std::string> settable_columns(const Model& model, const State& state) {
  std::set<std::string> columns;
  const auto add = [&](const std::string& name) {
    if (state.recorded(name)) columns.insert(name);
  };
  for (const Parameter& p : model.parameters) {
    for (const Term& term : p.terms) {
      for (const std::string& variable : term.basis.variables()) {
        if (reads_gravity(variable)) {
          add("payload");
        } else if (variable == "dT") {
          if (!state.sensors().empty()) add("temp_" + state.sensors().front());
        } else if (variable.starts_with("dT_")) {
          add("temp_" + variable.substr(3));
        } else if (!is_numbered(variable, "q") && !is_numbered(variable, "qr")) {
          add(variable);
        }
      }
    }
  }
  return columns;
}

Levels recorded_levels(const State& state, const std::set<std::string>& columns) {
  Levels levels;
  for (const std::string& name : columns) {
    if (is_numbered(name, "dir")) {
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
