#include "fitter/solve/least_squares.h"

#include <ceres/ceres.h>

#include <algorithm>
#include <memory>

#include "fitter/design/normal_equations.h"

namespace armtrue {
namespace {

// All measurements and penalties as one residual vector over one block of unknowns.
class WholeDesign final : public ceres::CostFunction {
 public:
  WholeDesign(Design& design, const std::vector<PenaltyRow>& penalties)
      : design_(design), penalties_(penalties) {
    mutable_parameter_block_sizes()->push_back(design.unknowns());
    set_num_residuals(static_cast<int>(design.rows()) * design.residuals_per_row() +
                      static_cast<int>(penalties.size()));
  }

  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override {
    const double* x = parameters[0];
    design_.set_unknowns(x);
    const int width = design_.unknowns();
    const int height = design_.residuals_per_row();
    double* jacobian = jacobians ? jacobians[0] : nullptr;
    if (jacobian)
      std::fill(jacobian, jacobian + static_cast<std::ptrdiff_t>(num_residuals()) * width, 0.0);
    design_.each_row(jacobian != nullptr, [&](std::size_t i, const Design::Row& row, const auto&) {
      double* rows =
          jacobian ? jacobian + static_cast<std::ptrdiff_t>(i) * height * width : nullptr;
      for (int r = 0; r < height; ++r) {
        residuals[static_cast<int>(i) * height + r] = row.residual[r];
        if (!rows) continue;
        for (std::size_t u = 0; u < row.unknowns.size(); ++u) {
          rows[r * width + row.unknowns[u]] = row.jacobian(r, static_cast<Eigen::Index>(u));
        }
      }
    });
    const int first = static_cast<int>(design_.rows()) * height;
    for (std::size_t p = 0; p < penalties_.size(); ++p) {
      const int at = first + static_cast<int>(p);
      residuals[at] = -penalties_[p].target;
      for (const auto& [unknown, factor] : penalties_[p].entries) {
        residuals[at] += factor * x[unknown];
        if (jacobian) jacobian[static_cast<std::ptrdiff_t>(at) * width + unknown] = factor;
      }
    }
    return std::all_of(residuals, residuals + num_residuals(),
                       [](double v) { return std::isfinite(v); });
  }

 private:
  Design& design_;
  const std::vector<PenaltyRow>& penalties_;
};

// Unknowns laid out for the block problem: all that are not table nodes in one block, every node a
// block of its own.
struct BlockLayout {
  std::vector<int> dense;                         // unknowns in the dense block
  std::vector<int> position_in_dense;             // of every unknown; −1 for nodes
  std::vector<double> dense_values, node_values;  // node_values by unknown

  explicit BlockLayout(const Design& design)
      : position_in_dense(static_cast<std::size_t>(design.unknowns()), -1) {
    node_values = design.unknown_values();
    for (int u = 0; u < design.unknowns(); ++u) {
      if (design.is_table_unknown(u)) continue;
      position_in_dense[static_cast<std::size_t>(u)] = static_cast<int>(dense.size());
      dense.push_back(u);
      dense_values.push_back(node_values[static_cast<std::size_t>(u)]);
    }
  }

  std::vector<double> gather() const {
    std::vector<double> x = node_values;
    for (std::size_t d = 0; d < dense.size(); ++d)
      x[static_cast<std::size_t>(dense[d])] = dense_values[d];
    return x;
  }

  double* block(int unknown) { return &node_values[static_cast<std::size_t>(unknown)]; }
};

// All rows of the design, evaluated at Ceres' point before it asks for them one by one.
class RowsAtPoint final : public ceres::EvaluationCallback {
 public:
  RowsAtPoint(Design& design, const BlockLayout& layout)
      : design_(design), layout_(layout), rows_(design.rows()) {}
  void PrepareForEvaluation(bool with_jacobian, bool new_point) override {
    if (new_point) design_.set_unknowns(layout_.gather().data());
    design_.each_row(with_jacobian, [&](std::size_t i, Design::Row& row, const auto&) {
      std::swap(rows_[i], row);
    });
  }
  const Design::Row& row(std::size_t i) const { return rows_[i]; }

 private:
  Design& design_;
  const BlockLayout& layout_;
  std::vector<Design::Row> rows_;
};

// One measurement; its blocks are the dense block and the nodes that its joints lie between.
class OneMeasurement final : public ceres::CostFunction {
 public:
  OneMeasurement(const RowsAtPoint& rows, const BlockLayout& layout, std::size_t row, int height,
                 std::vector<int> nodes)
      : rows_(rows), layout_(layout), index_(row), nodes_(std::move(nodes)) {
    mutable_parameter_block_sizes()->push_back(static_cast<int>(layout.dense.size()));
    for (std::size_t i = 0; i < nodes_.size(); ++i) mutable_parameter_block_sizes()->push_back(1);
    set_num_residuals(height);
  }

  bool Evaluate(double const* const*, double* residuals, double** jacobians) const override {
    const Design::Row& row = rows_.row(index_);
    const int height = num_residuals();
    for (int r = 0; r < height; ++r) residuals[r] = row.residual[r];
    if (!jacobians) return true;
    const auto width = static_cast<int>(layout_.dense.size());
    if (jacobians[0]) std::fill(jacobians[0], jacobians[0] + height * width, 0.0);
    for (std::size_t k = 0; k < nodes_.size(); ++k) {
      if (jacobians[k + 1]) std::fill(jacobians[k + 1], jacobians[k + 1] + height, 0.0);
    }
    for (std::size_t u = 0; u < row.unknowns.size(); ++u) {
      const int position = layout_.position_in_dense[static_cast<std::size_t>(row.unknowns[u])];
      double* block = jacobians[0];
      int stride = width, at = position;
      if (position < 0) {
        const auto found = std::find(nodes_.begin(), nodes_.end(), row.unknowns[u]);
        block = jacobians[1 + (found - nodes_.begin())];
        stride = 1;
        at = 0;
      }
      if (!block) continue;
      for (int r = 0; r < height; ++r)
        block[r * stride + at] = row.jacobian(r, static_cast<Eigen::Index>(u));
    }
    return true;
  }

 private:
  const RowsAtPoint& rows_;
  const BlockLayout& layout_;
  std::size_t index_;
  std::vector<int> nodes_;
};

// One penalty over the blocks that it touches.
class LinearRow final : public ceres::CostFunction {
 public:
  // `groups`: for each block, the (position in block, factor) pairs and the block's size.
  struct Group {
    int size;
    std::vector<std::pair<int, double>> entries;
  };
  LinearRow(std::vector<Group> groups, double target)
      : groups_(std::move(groups)), target_(target) {
    for (const Group& g : groups_) mutable_parameter_block_sizes()->push_back(g.size);
    set_num_residuals(1);
  }
  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override {
    residuals[0] = -target_;
    for (std::size_t g = 0; g < groups_.size(); ++g) {
      double* block = jacobians ? jacobians[g] : nullptr;
      if (block) std::fill(block, block + groups_[g].size, 0.0);
      for (const auto& [at, factor] : groups_[g].entries) {
        residuals[0] += factor * parameters[g][at];
        if (block) block[at] = factor;
      }
    }
    return true;
  }

 private:
  std::vector<Group> groups_;
  double target_;
};

ceres::Solver::Options solver_options(Accuracy accuracy) {
  ceres::Solver::Options options;
  options.trust_region_strategy_type = ceres::LEVENBERG_MARQUARDT;
  // Starts as a plain Gauss–Newton step: alignment leaves millimetres, where the problem is nearly
  // linear.
  options.initial_trust_region_radius = 1e12;
  options.max_trust_region_radius = 1e16;
  options.max_num_iterations = 50;
  options.function_tolerance = accuracy == Accuracy::kFull ? 1e-9 : 1e-3;
  options.gradient_tolerance = 1e-12;
  options.parameter_tolerance = 1e-9;
  options.logging_type = ceres::SILENT;
  options.num_threads = 1;
  // Bounds of nonlinear parameters only keep them sane; a search along every step for their sake
  // costs more than all steps.
  options.max_num_line_search_step_size_iterations = 0;
  return options;
}

void bound_nonlinear(const Design& design, ceres::Problem& problem, double* block, int first) {
  for (int j = 0; j < design.nonlinear_count(); ++j) {
    const NonlinearParameter& p = design.model().nonlinear[static_cast<std::size_t>(j)];
    problem.SetParameterLowerBound(block, first + j, p.lower);
    problem.SetParameterUpperBound(block, first + j, p.upper);
  }
}

SolveSummary report(const ceres::Solver::Summary& summary) {
  return {static_cast<int>(summary.iterations.size()),
          summary.termination_type == ceres::CONVERGENCE, 2.0 * summary.final_cost,
          summary.message};
}

SolveSummary solve_whole(Design& design, const std::vector<PenaltyRow>& penalties,
                         Accuracy accuracy) {
  std::vector<double> x = design.unknown_values();
  ceres::Problem problem;
  problem.AddResidualBlock(new WholeDesign(design, penalties), nullptr, x.data());
  bound_nonlinear(design, problem, x.data(), design.unknowns() - design.nonlinear_count());
  ceres::Solver::Options options = solver_options(accuracy);
  options.linear_solver_type = ceres::DENSE_NORMAL_CHOLESKY;
  ceres::Solver::Summary summary;
  ceres::Solve(options, &problem, &summary);
  design.set_unknowns(x.data());
  return report(summary);
}

SolveSummary solve_blocks(Design& design, const std::vector<PenaltyRow>& penalties,
                          Accuracy accuracy) {
  BlockLayout layout(design);
  RowsAtPoint rows(design, layout);
  ceres::Problem::Options problem_options;
  problem_options.evaluation_callback = &rows;
  ceres::Problem problem(problem_options);
  Design::Row row;
  const auto blocks_of = [&](const std::vector<int>& nodes) {
    std::vector<double*> blocks{layout.dense_values.data()};
    for (const int node : nodes) blocks.push_back(layout.block(node));
    return blocks;
  };
  for (std::size_t i = 0; i < design.rows(); ++i) {
    if (design.weights()[i] == 0.0) continue;
    design.evaluate(i, true, row);
    std::vector<int> nodes;
    for (const int unknown : row.unknowns) {
      if (layout.position_in_dense[static_cast<std::size_t>(unknown)] < 0) nodes.push_back(unknown);
    }
    const std::vector<double*> blocks = blocks_of(nodes);
    problem.AddResidualBlock(
        new OneMeasurement(rows, layout, i, design.residuals_per_row(), std::move(nodes)), nullptr,
        blocks);
  }
  for (const PenaltyRow& penalty : penalties) {
    std::vector<LinearRow::Group> groups;
    std::vector<double*> blocks;
    LinearRow::Group dense{static_cast<int>(layout.dense.size()), {}};
    for (const auto& [unknown, factor] : penalty.entries) {
      const int position = layout.position_in_dense[static_cast<std::size_t>(unknown)];
      if (position >= 0) {
        dense.entries.emplace_back(position, factor);
      } else {
        groups.push_back({1, {{0, factor}}});
        blocks.push_back(layout.block(unknown));
      }
    }
    if (!dense.entries.empty()) {
      groups.push_back(dense);
      blocks.push_back(layout.dense_values.data());
    }
    problem.AddResidualBlock(new LinearRow(std::move(groups), penalty.target), nullptr, blocks);
  }
  if (problem.HasParameterBlock(layout.dense_values.data())) {
    bound_nonlinear(design, problem, layout.dense_values.data(),
                    static_cast<int>(layout.dense.size()) - design.nonlinear_count());
  }
  ceres::Solver::Options options = solver_options(accuracy);
  options.linear_solver_type = ceres::SPARSE_NORMAL_CHOLESKY;
  ceres::Solver::Summary summary;
  ceres::Solve(options, &problem, &summary);
  design.set_unknowns(layout.gather().data());
  return report(summary);
}

}  // namespace

SolveSummary solve(Design& design, double smoothness_sigma, Accuracy accuracy) {
  if (design.unknowns() == 0) return {0, true, 0.0, "nothing to solve for"};
  const std::vector<PenaltyRow> penalties = penalty_rows(design, smoothness_sigma);
  bool tables = false;
  for (int u = 0; u < design.unknowns() && !tables; ++u) tables = design.is_table_unknown(u);
  return tables ? solve_blocks(design, penalties, accuracy)
                : solve_whole(design, penalties, accuracy);
}

}  // namespace armtrue
