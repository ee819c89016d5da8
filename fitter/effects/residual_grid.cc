#include <algorithm>
#include <cmath>
#include <functional>
#include <numeric>
#include <set>

#include "fitter/effects/tables.h"

namespace armtrue {
namespace {

// Displacement of the arm beyond joint 1, in frame 1, over a grid in joint angles 1 to 3. Cells
// regular in joint angles are fan-shaped in space (sectors of rings), as in the IRB2400 paper's
// third level; frame 1 turns with them.
class ResidualGrid final : public Effect {
 public:
  ResidualGrid()
      : Effect({.id = "residual_grid",
                .summary = "what no effect explains: multilinear grid over joints 1 to 3",
                .bound = "2 mm: the multilevel paper (ABB IRB2400); more than that is geometry "
                         "that was not fitted",
                .role = Role::kTable,
                .joints = JointRule::kNone,
                .options = {{"nodes", "[int]",
                             "nodes over joints 1, 2, 3; default chosen by cross-validation"}}}) {}

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

  using Index = std::vector<int>;  // of a node, by axis

  // Nodes without a measurement in their cells are left out: there the grid is zero.
  static std::set<Index> covered_nodes(const EffectContext& context, const TableReference& table) {
    std::set<Index> covered;
    const std::size_t axes = table.axes.size();
    for (std::size_t row = 0; row < context.state.rows(); ++row) {
      for (std::size_t corner = 0; corner < (std::size_t{1} << axes); ++corner) {
        Index index;
        for (std::size_t a = 0; a < axes; ++a) {
          const auto& nodes = table.axes[a].nodes;
          const double q = context.state.column(table.axes[a].variable)[row];
          const double at = nodes.size() > 1 ? (q - nodes.front()) / (nodes[1] - nodes[0]) : 0.0;
          const int last = static_cast<int>(nodes.size()) - 1;
          const int cell = static_cast<int>(std::clamp(at, 0.0, last - 0.001));
          index.push_back(std::min(cell + static_cast<int>((corner >> a) & 1U), last));
        }
        covered.insert(std::move(index));
      }
    }
    return covered;
  }

  static std::string node_name(const Index& index, int component) {
    std::string name;
    for (const int i : index) name += std::to_string(i + 1) + "_";
    return parameter_name("residual_grid", {}, "node" + name + kComponentNames[component]);
  }

  EffectTerms grid_terms(const EffectContext& context, const TableReference& table) const {
    EffectTerms terms;
    const std::set<Index> covered = covered_nodes(context, table);
    const std::size_t axes = table.axes.size();
    std::vector<Penalty> mean(3);
    for (const Index& index : covered) {
      std::string basis;
      for (std::size_t a = 0; a < axes; ++a) {
        if (table.axes[a].nodes.size() < 2) continue;
        basis +=
            (basis.empty() ? "" : "*") + hat_expression(table.axes[a].variable, table.axes[a].nodes,
                                                        static_cast<std::size_t>(index[a]));
      }
      for (int c = 0; c < 3; ++c) {
        Parameter& p =
            add(terms, {}, "", "m", kLargest, on_link(1, c), basis.empty() ? "1" : basis);
        p.name = node_name(index, c);
        p.terms.front().table = table;
        p.terms.front().table->id += std::string(".") + kComponentNames[c];
        p.terms.front().table->index = index;
        mean[static_cast<std::size_t>(c)].row.emplace_back(p.name, 1.0);
        terms.penalties.push_back(value_penalty(p.name, kValue));
      }
      for (std::size_t a = 0; a < axes; ++a) {
        Index before = index, after = index;
        before[a] -= 1;
        after[a] += 1;
        if (!covered.contains(before) || !covered.contains(after)) continue;
        for (int c = 0; c < 3; ++c) {
          terms.penalties.push_back(
              curvature_penalty(node_name(before, c), node_name(index, c), node_name(after, c)));
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
