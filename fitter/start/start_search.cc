#include "fitter/start/start_search.h"

#include <ceres/ceres.h>

#include <Eigen/SparseCore>
#include <algorithm>
#include <optional>

#include "fitter/design/normal_equations.h"

namespace armtrue {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

// Enough equations to rank starts; the fit that follows uses all.
constexpr std::size_t kLeastEquations = 1200;
constexpr std::size_t kEquationsPerUnknown = 2;
constexpr std::size_t kDescents = 6;
constexpr int kMostIterations = 30;

// min |r + B b + A(theta) c| over b, c and theta, with b eliminated: c are the coefficients whose
// basis contains a nonlinear parameter, b all others.
class ReducedProblem {
 public:
  ReducedProblem(Design& design, double smoothness_sigma)
      : design_(design), before_(design.unknown_values()) {
    const std::vector<int>& free = design.free_parameters();
    position_.resize(free.size());
    for (std::size_t u = 0; u < free.size(); ++u) {
      searched_.push_back(design.basis().is_searched(free[u]));
      position_[u] = searched_[u] ? coefficients_++ : others_++;
      if (searched_[u]) before_[u] = 0.0;
    }
    const auto height = static_cast<std::size_t>(design.residuals_per_row());
    const std::size_t wanted = std::max(
        kLeastEquations, kEquationsPerUnknown * static_cast<std::size_t>(design.unknowns()));
    for (std::size_t i = 0; i < design.rows(); ++i) {
      if (design.weights()[i] != 0.0) rows_.push_back(i);
    }
    const std::size_t stride = std::max<std::size_t>(1, rows_.size() * height / wanted);
    for (std::size_t k = 0; k * stride < rows_.size(); ++k) rows_[k] = rows_[k * stride];
    rows_.resize((rows_.size() + stride - 1) / stride);
    linearise(penalty_rows(design, smoothness_sigma));
  }

  Index coefficients() const { return coefficients_; }
  Index equations() const { return residual_.size(); }

  // A(theta), b eliminated.
  MatrixXd columns(const std::vector<double>& theta) { return eliminate(raw_columns(theta)); }

  // The derivative of A(theta) c in theta at the theta of the last evaluation, b eliminated.
  MatrixXd slopes(const double* c) {
    design_.basis().make_slopes();
    MatrixXd a = MatrixXd::Zero(equations(), design_.nonlinear_count());
    for (Index j = 0; j < a.cols(); ++j) {
      for (std::size_t k = 0; k < rows_.size(); ++k) {
        design_.basis().nonlinear_row(rows_[k], static_cast<std::size_t>(j), entries_);
        for (const BasisTable::Entry& e : entries_) {
          const int unknown = design_.unknown_of(e.parameter);
          if (unknown >= 0) add(a, k, j, e, c[position_[static_cast<std::size_t>(unknown)]]);
        }
      }
    }
    return eliminate(std::move(a));
  }

  // r, b eliminated.
  const VectorXd& residual() const { return residual_; }

  // All unknowns of the design, b in closed form.
  std::vector<double> unknowns(const VectorXd& c, const std::vector<double>& theta) {
    const VectorXd left = raw_residual_ + raw_columns(theta) * c;
    const VectorXd b = -others_factor_->solve(others_columns_.transpose() * left);
    std::vector<double> x = before_;
    for (std::size_t u = 0; u < position_.size(); ++u)
      x[u] += searched_[u] ? c[position_[u]] : b[position_[u]];
    std::copy(theta.begin(), theta.end(), x.end() - static_cast<std::ptrdiff_t>(theta.size()));
    return x;
  }

 private:
  void linearise(const std::vector<PenaltyRow>& penalties) {
    design_.set_unknowns(before_.data());
    const Index height = design_.residuals_per_row();
    const Index measured = static_cast<Index>(rows_.size()) * height;
    const Index all = measured + static_cast<Index>(penalties.size());
    penalty_columns_ = MatrixXd::Zero(all, coefficients_);
    raw_residual_.resize(all);
    std::vector<Eigen::Triplet<double>> entries;
    MatrixXd information = MatrixXd::Zero(others_, others_);
    // Nonzero columns of the equations that add_equations() adds next: index, values.
    std::vector<std::pair<Index, VectorXd>> own;
    const auto add_equations = [&](Index at) {
      for (const auto& [a, first] : own) {
        for (Index h = 0; h < first.size(); ++h) entries.emplace_back(at + h, a, first[h]);
        for (const auto& [b, second] : own) {
          if (a >= b) information(a, b) += first.dot(second);
        }
      }
      own.clear();
    };
    Design::Row row;
    for (std::size_t k = 0; k < rows_.size(); ++k) {
      const Index at = static_cast<Index>(k) * height;
      design_.evaluate(rows_[k], true, row);
      raw_residual_.segment(at, height) = row.residual.head(height);
      for (std::size_t u = 0; u < row.unknowns.size(); ++u) {
        const auto unknown = static_cast<std::size_t>(row.unknowns[u]);
        if (unknown >= position_.size() || searched_[unknown]) continue;
        own.emplace_back(position_[unknown], row.jacobian.col(static_cast<Index>(u)).head(height));
      }
      add_equations(at);
      MatrixXd geometric = design_.geometric_jacobian();
      for (Index c = 0; c < geometric.cols(); ++c)
        geometric.col(c) = design_.whiten(rows_[k], geometric.col(c));
      geometric_.push_back(geometric.topRows(height));
    }
    for (std::size_t p = 0; p < penalties.size(); ++p) {
      const Index at = measured + static_cast<Index>(p);
      raw_residual_[at] = -penalties[p].target;
      for (const auto& [unknown, factor] : penalties[p].entries) {
        const auto u = static_cast<std::size_t>(unknown);
        if (u >= position_.size()) continue;
        raw_residual_[at] += factor * before_[u];
        if (searched_[u]) {
          penalty_columns_(at, position_[u]) = factor;
        } else {
          own.emplace_back(position_[u], VectorXd::Constant(1, factor));
        }
      }
      add_equations(at);
    }
    others_columns_.resize(all, others_);
    others_columns_.setFromTriplets(entries.begin(), entries.end());
    others_factor_.emplace(information);
    residual_ = eliminate(raw_residual_);
  }

  MatrixXd raw_columns(const std::vector<double>& theta) {
    std::vector<double> x = before_;
    std::copy(theta.begin(), theta.end(), x.end() - static_cast<std::ptrdiff_t>(theta.size()));
    design_.set_unknowns(x.data());
    MatrixXd a = penalty_columns_;
    for (std::size_t k = 0; k < rows_.size(); ++k) {
      design_.basis().searched_row(rows_[k], entries_);
      for (const BasisTable::Entry& e : entries_) {
        const int unknown = design_.unknown_of(e.parameter);
        if (unknown >= 0) add(a, k, position_[static_cast<std::size_t>(unknown)], e, 1.0);
      }
    }
    return a;
  }

  void add(MatrixXd& a, std::size_t k, Index column, const BasisTable::Entry& e, double factor) {
    const Index height = geometric_[k].rows();
    a.block(static_cast<Index>(k) * height, column, height, 1) +=
        factor * e.value * geometric_[k].col(e.coordinate);
  }

  template <typename Columns>
  Columns eliminate(Columns a) const {
    a -= others_columns_ * others_factor_->solve_matrix(others_columns_.transpose() * a);
    return a;
  }

  Design& design_;
  std::vector<double> before_;   // unknowns at which the chain is linearised
  std::vector<bool> searched_;   // by linear unknown: true if it belongs to c
  std::vector<Index> position_;  // by linear unknown: its index in c or b
  Index coefficients_ = 0, others_ = 0;
  std::vector<std::size_t> rows_;
  std::vector<MatrixXd> geometric_;  // whitened, by row
  // Sparse: a node of a table acts in few rows.
  Eigen::SparseMatrix<double, Eigen::RowMajor> others_columns_;
  MatrixXd penalty_columns_;
  VectorXd raw_residual_, residual_;
  std::optional<ScaledCholesky> others_factor_;
  std::vector<BasisTable::Entry> entries_;
};

class ReducedCost final : public ceres::CostFunction {
 public:
  explicit ReducedCost(ReducedProblem& problem, int searched) : problem_(problem) {
    set_num_residuals(static_cast<int>(problem.equations()));
    mutable_parameter_block_sizes()->push_back(static_cast<int>(problem.coefficients()));
    mutable_parameter_block_sizes()->push_back(searched);
  }

  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override {
    using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
    const int searched = parameter_block_sizes()[1];
    const std::vector<double> theta(parameters[1], parameters[1] + searched);
    const MatrixXd a = problem_.columns(theta);
    const Eigen::Map<const VectorXd> c(parameters[0], problem_.coefficients());
    Eigen::Map<VectorXd>(residuals, num_residuals()) = problem_.residual() + a * c;
    if (jacobians && jacobians[0]) {
      Eigen::Map<RowMajor>(jacobians[0], a.rows(), a.cols()) = a;
    }
    if (jacobians && jacobians[1]) {
      Eigen::Map<RowMajor>(jacobians[1], a.rows(), searched) = problem_.slopes(parameters[0]);
    }
    return a.allFinite();
  }

 private:
  ReducedProblem& problem_;
};

struct Start {
  double cost;
  std::vector<double> theta;
  VectorXd c;
  std::vector<std::size_t> at{};  // place in the grid of starts
};

bool are_neighbours(const Start& a, const Start& b) {
  for (std::size_t j = 0; j < a.at.size(); ++j) {
    if (std::max(a.at[j], b.at[j]) - std::min(a.at[j], b.at[j]) > 1) return false;
  }
  return true;
}

// Starts that no neighbour in the grid improves on, best first: neighbouring starts in one valley
// would end in the same minimum.
std::vector<Start> valleys(std::vector<Start> starts) {
  std::sort(starts.begin(), starts.end(),
            [](const Start& a, const Start& b) { return a.cost < b.cost; });
  std::vector<Start> lowest;
  for (auto start = starts.begin(); start != starts.end(); ++start) {
    if (std::none_of(starts.begin(), start,
                     [&](const Start& better) { return are_neighbours(better, *start); }))
      lowest.push_back(*start);
  }
  return lowest;
}

Start closed_form(ReducedProblem& problem, const std::vector<double>& theta) {
  const MatrixXd a = problem.columns(theta);
  const MatrixXd information = a.transpose() * a;
  const VectorXd right = a.transpose() * problem.residual();
  const ScaledCholesky factor(information);
  const VectorXd c = factor.ok() ? VectorXd(-factor.solve(right)) : VectorXd::Zero(right.size());
  return {problem.residual().squaredNorm() + right.dot(c), theta, c, {}};
}

Start descend(ReducedProblem& problem, const Design& design, Start start) {
  ceres::Problem descent;
  descent.AddResidualBlock(new ReducedCost(problem, design.nonlinear_count()), nullptr,
                           start.c.data(), start.theta.data());
  for (int j = 0; j < design.nonlinear_count(); ++j) {
    const NonlinearParameter& p = design.model().nonlinear[static_cast<std::size_t>(j)];
    descent.SetParameterLowerBound(start.theta.data(), j, p.lower);
    descent.SetParameterUpperBound(start.theta.data(), j, p.upper);
  }
  ceres::Solver::Options options;
  options.linear_solver_type = ceres::DENSE_QR;
  options.max_num_iterations = kMostIterations;
  options.function_tolerance = 1e-6;
  options.logging_type = ceres::SILENT;
  options.num_threads = 1;
  options.max_num_line_search_step_size_iterations = 0;
  ceres::Solver::Summary summary;
  ceres::Solve(options, &descent, &summary);
  start.cost = 2.0 * summary.final_cost;
  return start;
}

}  // namespace

std::vector<double> search_starts(Design& design, double smoothness_sigma) {
  const std::vector<double> present = design.unknown_values();
  const std::vector<NonlinearParameter>& nonlinear = design.model().nonlinear;
  ReducedProblem problem(design, smoothness_sigma);
  if (problem.coefficients() == 0) {
    design.set_unknowns(present.data());
    return present;
  }
  std::vector<std::vector<double>> grid;
  for (const NonlinearParameter& p : nonlinear) {
    grid.push_back(p.starts.empty() ? std::vector<double>{p.value} : p.starts);
    std::sort(grid.back().begin(), grid.back().end());
  }
  std::vector<Start> starts;
  std::vector<std::size_t> at(nonlinear.size(), 0);
  for (bool more = true; more;) {
    std::vector<double> theta;
    for (std::size_t j = 0; j < at.size(); ++j) theta.push_back(grid[j][at[j]]);
    starts.push_back(closed_form(problem, theta));
    starts.back().at = at;
    more = false;
    for (std::size_t j = 0; j < at.size() && !more; ++j) {
      more = ++at[j] < grid[j].size();
      if (!more) at[j] = 0;
    }
  }
  const bool one_start = starts.size() == 1;
  starts = valleys(std::move(starts));
  if (starts.size() > kDescents) starts.resize(kDescents);
  Start best = starts.front();
  for (std::size_t k = 0; k < starts.size() && !one_start; ++k) {
    Start end = descend(problem, design, starts[k]);
    if (end.cost < best.cost) best = std::move(end);
  }
  std::vector<double> found = problem.unknowns(best.c, best.theta);
  design.set_unknowns(present.data());
  return found;
}

}  // namespace armtrue
