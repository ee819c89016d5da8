#include <algorithm>
#include <cmath>
#include <functional>
#include <numeric>

#include "fitter/effects/tables.h"

namespace armtrue {
namespace {

// Displacement of the arm beyond joint 1, in frame 1, over a grid in joint angles 1 to 3. Cells
// regular in joint angles are fan-shaped in space (sectors of rings), as in the IRB2400 paper's
// third level; frame 1 turns with them.
class ResidualGrid final : public Effect {
 public:
  std::string id() const override { return "residual_grid"; }
  std::string summary() const override {
    return "what no effect explains: multilinear grid over joints 1 to 3";
  }
  Role role() const override { return Role::kTable; }
  JointRule joint_rule() const override { return JointRule::kNone; }
  std::string bound_text() const override {
    return "2 mm: the multilevel paper (ABB IRB2400); more than that is geometry that was not "
           "fitted";
  }
  std::vector<EffectOption> options() const override {
    return {{"nodes", "[int]", "nodes over joints 1, 2, 3; default chosen by cross-validation"}};
  }

  EffectTerms build(const EffectContext& context, const EffectRequest& request) const override {
    const int axes = std::min(3, context.joint_count());
    const std::vector<int> counts =
        request.options.value("nodes", default_nodes(context.state.rows(), axes));
    if (static_cast<int>(counts.size()) != axes) {
      throw ModelError("effect residual_grid: nodes has " + std::to_string(counts.size()) +
                       " numbers, expected " + std::to_string(axes));
    }
    TableReference table;
    table.id = "residual_grid";
    for (int a = 0; a < axes; ++a) {
      const int count = counts[static_cast<std::size_t>(a)];
      if (count < 2 || count > 64)
        throw ModelError("effect residual_grid: nodes must be 2 to 64 on each axis");
      const std::string variable = "q" + std::to_string(a + 1);
      table.axes.push_back({variable, nodes_over(context.state.column(variable), 1e9,
                                                 static_cast<std::size_t>(count))});
    }
    return grid_terms(context, table);
  }

  // On each axis in turn one more node, or all cells halved, because a strongly curved shape often
  // appears only then. There are at most as many nodes as poses.
  std::vector<EffectRequest> refinements(const EffectContext& context,
                                         const EffectRequest& request) const override {
    const auto with_nodes = [&](const std::vector<int>& nodes) {
      EffectRequest closed = request;
      closed.options["nodes"] = nodes;
      return closed;
    };
    const int axes = std::min(3, context.joint_count());
    if (!request.options.contains("nodes")) {
      return {with_nodes(std::vector<int>(static_cast<std::size_t>(axes), kFewest))};
    }
    std::vector<EffectRequest> finer;
    const auto present = request.options["nodes"].get<std::vector<int>>();
    const int most = std::min(kMost, static_cast<int>(context.state.rows()));
    for (std::size_t a = 0; a < present.size(); ++a) {
      for (const int count : {present[a] + 1, 2 * present[a] - 1}) {
        std::vector<int> nodes = present;
        nodes[a] = count;
        const int size = std::accumulate(nodes.begin(), nodes.end(), 1, std::multiplies<>());
        if (size <= most) finer.push_back(with_nodes(nodes));
      }
    }
    return finer;
  }

  // It corrects without naming a cause: recommended by the diagnosis, never one of its candidates.
  std::vector<EffectRequest> candidates(const EffectContext&) const override { return {}; }

 private:
  static constexpr double kValue = 4.0;     // prior sigma of a node's value in units of smoothness
  static constexpr double kLargest = 2e-3;  // [m]
  static constexpr int kFewest = 3;         // on an axis, if the number is not given
  static constexpr int kMost = 216;         // in total, so that the search takes seconds

  static std::vector<int> default_nodes(std::size_t rows, int axes) {
    // Three equations a pose, three unknowns a node: about six poses for each node.
    const int side = static_cast<int>(std::lround(std::cbrt(static_cast<double>(rows) / 6.0)));
    return std::vector<int>(static_cast<std::size_t>(axes), std::clamp(side, 3, 8));
  }

  // Nodes without a measurement in their cells are left out: there the grid is zero.
  static std::vector<bool> covered_nodes(const EffectContext& context,
                                         const TableReference& table) {
    std::size_t size = 1;
    for (const auto& axis : table.axes) size *= axis.nodes.size();
    std::vector<bool> covered(size, false);
    const std::size_t axes = table.axes.size();
    for (std::size_t row = 0; row < context.state.rows(); ++row) {
      std::vector<std::size_t> cell(axes);
      for (std::size_t a = 0; a < axes; ++a) {
        const auto& nodes = table.axes[a].nodes;
        const double q = context.state.column(table.axes[a].variable)[row];
        const double at = nodes.size() > 1 ? (q - nodes.front()) / (nodes[1] - nodes[0]) : 0.0;
        cell[a] = static_cast<std::size_t>(
            std::clamp(at, 0.0, static_cast<double>(nodes.size()) - 1.001));
      }
      for (std::size_t corner = 0; corner < (std::size_t{1} << axes); ++corner) {
        std::size_t flat = 0;
        for (std::size_t a = 0; a < axes; ++a) {
          flat = flat * table.axes[a].nodes.size() +
                 std::min(cell[a] + ((corner >> a) & 1U), table.axes[a].nodes.size() - 1);
        }
        covered[flat] = true;
      }
    }
    return covered;
  }

  static std::string node_name(const std::vector<int>& index, int component) {
    std::string name;
    for (const int i : index) name += std::to_string(i + 1) + "_";
    return parameter_name("residual_grid", {}, "node" + name + kComponentNames[component]);
  }

  EffectTerms grid_terms(const EffectContext& context, const TableReference& table) const {
    EffectTerms terms;
    const std::vector<bool> covered = covered_nodes(context, table);
    const std::size_t axes = table.axes.size();
    const auto index_of = [&](std::size_t flat) {
      std::vector<int> index(axes);
      for (std::size_t a = axes; a-- > 0;) {
        index[a] = static_cast<int>(flat % table.axes[a].nodes.size());
        flat /= table.axes[a].nodes.size();
      }
      return index;
    };
    const auto flat_of = [&](const std::vector<int>& index) {
      std::size_t flat = 0;
      for (std::size_t a = 0; a < axes; ++a)
        flat = flat * table.axes[a].nodes.size() + static_cast<std::size_t>(index[a]);
      return flat;
    };
    std::vector<Penalty> mean(3);
    for (std::size_t flat = 0; flat < covered.size(); ++flat) {
      if (!covered[flat]) continue;
      const std::vector<int> index = index_of(flat);
      std::string basis;
      for (std::size_t a = 0; a < axes; ++a) {
        if (table.axes[a].nodes.size() < 2) continue;
        basis +=
            (basis.empty() ? "" : "*") + hat_expression(table.axes[a].variable, table.axes[a].nodes,
                                                        static_cast<std::size_t>(index[a]));
      }
      for (int c = 0; c < 3; ++c) {
        Parameter p =
            single_term(id(), {}, "", "m", kLargest, on_link(1, c), basis.empty() ? "1" : basis);
        p.name = node_name(index, c);
        p.terms.front().table = table;
        p.terms.front().table->id += std::string(".") + kComponentNames[c];
        p.terms.front().table->index = index;
        mean[static_cast<std::size_t>(c)].row.emplace_back(p.name, 1.0);
        terms.penalties.push_back(value_penalty(p.name, kValue));
        terms.parameters.push_back(std::move(p));
      }
      for (std::size_t a = 0; a < axes; ++a) {
        std::vector<int> before = index, after = index;
        before[a] -= 1;
        after[a] += 1;
        if (before[a] < 0 || after[a] >= static_cast<int>(table.axes[a].nodes.size())) continue;
        if (!covered[flat_of(before)] || !covered[flat_of(after)]) continue;
        for (int c = 0; c < 3; ++c) {
          Penalty smooth;
          smooth.smoothness = true;
          smooth.sigma = kSecondDifference;
          smooth.row = {
              {node_name(before, c), 1.0}, {node_name(index, c), -2.0}, {node_name(after, c), 1.0}};
          terms.penalties.push_back(smooth);
        }
      }
    }
    for (Penalty& penalty : mean) {
      penalty.sigma = 1e-9 * static_cast<double>(penalty.row.size());
      terms.penalties.push_back(penalty);
    }
    return terms;
  }
};

const RegisterEffect<ResidualGrid> registered_residual_grid;

}  // namespace
}  // namespace armtrue
