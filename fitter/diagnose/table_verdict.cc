#include "fitter/diagnose/table_verdict.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <nlohmann/json.hpp>
#include <numbers>

#include "fitter/common/dense.h"
#include "fitter/evidence/words.h"

namespace armtrue {
namespace {

// Shares below these are no finding: smooth functions of any form reach them.
constexpr double kWavesHold = 0.5, kLineHolds = 0.5;
// A wave needs four nodes to be one.
constexpr double kNodesPerWave = 4.0;
constexpr double kFirstLine = 3.0, kLineStep = 0.5;
constexpr double kStraight = 1e-9;  // of the range: rounding

// Whether `basis` is a straight line over `variable`, and not constant: the mean of a table belongs
// to the joint offset.
bool is_line(const State& state, const Expression& basis, const std::string& variable) {
  const std::vector<double>& at = state.column(variable);
  const std::vector<double> values = state.values(basis);
  const auto [low, high] = std::ranges::minmax_element(at);
  const auto first = static_cast<std::size_t>(low - at.begin());
  const auto last = static_cast<std::size_t>(high - at.begin());
  if (at[first] == at[last] || values[first] == values[last]) return false;
  const double slope = (values[last] - values[first]) / (at[last] - at[first]);
  for (std::size_t i = 0; i < at.size(); ++i) {
    const double off = values[i] - values[first] - slope * (at[i] - at[first]);
    if (std::abs(off) > kStraight * std::abs(values[last] - values[first])) return false;
  }
  return true;
}

// Σ r² of `values` after fitting a constant, a line and waves of these cycles.
double left_by(const Eigen::VectorXd& at, const Eigen::VectorXd& values,
               const std::vector<double>& cycles) {
  Eigen::MatrixXd columns(at.size(), 2 + 2 * static_cast<Eigen::Index>(cycles.size()));
  columns.col(0).setOnes();
  columns.col(1) = at;
  for (std::size_t i = 0; i < cycles.size(); ++i) {
    const auto c = 2 + 2 * static_cast<Eigen::Index>(i);
    columns.col(c) = (cycles[i] * at.array()).sin();
    columns.col(c + 1) = (cycles[i] * at.array()).cos();
  }
  return (values - columns * least_squares(columns, values)).squaredNorm();
}

void find_waves(const std::map<double, double>& nodes, TableVerdict& verdict) {
  const auto count = static_cast<Eigen::Index>(nodes.size());
  if (count < 12) return;
  Eigen::VectorXd at(count), values(count);
  Eigen::Index i = 0;
  for (const auto& [x, y] : nodes) {
    at[i] = x;
    values[i++] = y;
  }
  const double range = at[count - 1] - at[0];
  if (range < std::numbers::pi / 2) return;  // a shorter range does not show one wave a turn
  const double plain = left_by(at, values, {});
  const double beyond = left_by(at, values, {1.0, 2.0});
  if (!(plain > 0.0) || !(beyond > 0.0)) return;
  verdict.waves = 1.0 - beyond / plain;
  const double finest =
      2.0 * std::numbers::pi / (kNodesPerWave * range / static_cast<double>(count));
  double least = beyond;
  for (double cycles = kFirstLine; cycles <= finest; cycles += kLineStep) {
    const double left = left_by(at, values, {1.0, 2.0, cycles});
    if (left >= least) continue;
    least = left;
    verdict.cycles = cycles;
  }
  verdict.cycles_hold = (beyond - least) / plain;
  if (verdict.cycles_hold < kLineHolds) verdict.cycles = verdict.cycles_hold = 0.0;
}

std::string next_of(const TableVerdict& t) {
  if (t.joints.empty())
    return "record possible causes (temperatures, payload, directions), and diagnose again";
  const std::string joint = std::to_string(t.joints.front());
  if (t.cycles > 0.0)
    return "try gear_mesh on joint " + joint + " with cycles=[" + number_words(t.cycles) + "]";
  if (t.waves > kWavesHold) return "try gear_harmonics on joint " + joint + " instead";
  return "turn joint " + joint +
         " alone in fine steps, with two payloads: an error of its gear stays the same, a "
         "deflection grows";
}

std::string next_of_slide(int joint) {
  return "move joint " + std::to_string(joint) +
         " alone in fine steps: a wave as long as the travel per turn of its screw or pinion is "
         "gear_mesh, with lead or wavelengths";
}

}  // namespace

std::vector<TableVerdict> tables_of(const Fit& fit) {
  std::map<std::string, std::map<double, double>> nodes;  // of tables over one variable, by id
  std::map<std::string, TableVerdict> found;
  for (const Parameter& p : fit.model().parameters) {
    if (p.terms.empty() || !p.terms.front().table) continue;
    const TableReference& table = *p.terms.front().table;
    TableVerdict& verdict = found[table.id];
    verdict.effect = p.effect;
    verdict.joints = p.joints;
    ++verdict.nodes;
    if (table.axes.size() != 1) continue;
    nodes[table.id][table.axes.front().nodes[static_cast<std::size_t>(table.index.front())]] =
        p.value;
  }
  std::vector<TableVerdict> result;
  for (auto& [id, verdict] : found) {
    verdict.nodes_per_pose = verdict.nodes / std::max(1.0, 1.0 * fit.measurements().poses.poses);
    const bool slides = !verdict.joints.empty() && fit.context().prismatic(verdict.joints.front());
    if (nodes.contains(id) && !slides) find_waves(nodes.at(id), verdict);
    verdict.next = slides ? next_of_slide(verdict.joints.front()) : next_of(verdict);
    result.push_back(std::move(verdict));
  }
  return result;
}

bool is_part_of_tables(const Block& block, const Fit& fit) {
  const auto in_a_table = [&](const Term& term) {
    return std::ranges::any_of(fit.model().parameters, [&](const Parameter& p) {
      if (p.terms.empty() || !p.terms.front().table) return false;
      const TableReference& table = *p.terms.front().table;
      const bool is_first_node = table.index == std::vector{0};  // each table once, not each node
      return is_first_node && p.terms.front().coordinate == term.coordinate &&
             is_line(fit.state(), term.basis, table.axes.front().variable);
    });
  };
  return std::ranges::all_of(block.terms.parameters, [&](const Parameter& p) {
    return std::ranges::all_of(p.terms, in_a_table);
  });
}

nlohmann::json to_json(const std::vector<TableVerdict>& tables) {
  nlohmann::json result = nlohmann::json::array();
  for (const TableVerdict& t : tables) {
    result.push_back({{"effect", t.effect},
                      {"joints", t.joints},
                      {"verdict", "a table, not physics"},
                      {"nodes", t.nodes},
                      {"nodes_per_pose", t.nodes_per_pose},
                      {"waves", t.waves},
                      {"next", t.next}});
    result.back()["cycles"] = nullptr;
    if (t.cycles > 0.0) result.back()["cycles"] = t.cycles;
  }
  return result;
}

std::string sentence_of(const std::vector<TableVerdict>& tables) {
  if (tables.empty()) return "";
  double nodes = 0.0, per_pose = 0.0;
  std::map<std::string, std::string> joints_of;  // by effect
  for (const TableVerdict& t : tables) {
    nodes += t.nodes;
    per_pose += t.nodes_per_pose;
    std::string& joints = joints_of[t.effect];
    for (const int k : t.joints) joints += (joints.empty() ? " " : ",") + std::to_string(k);
  }
  std::string which;
  for (const auto& [effect, joints] : joints_of)
    which += (which.empty() ? "" : " and ") + effect + joints;
  // Advises on the table with the clearest wave.
  const auto clearest = std::max_element(
      tables.begin(), tables.end(), [](const TableVerdict& a, const TableVerdict& b) {
        return std::max(a.waves, a.cycles_hold) < std::max(b.waves, b.cycles_hold);
      });
  char cost[80];
  std::snprintf(cost, sizeof cost, "%.0f nodes, %.2g for each pose", nodes, per_pose);
  return which + ": a table, not physics (" + cost +
         "): it describes the error only where poses were measured; to find a physical effect, " +
         clearest->next;
}

}  // namespace armtrue
