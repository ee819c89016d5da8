#include "fitter/design/normal_equations.h"

#include <cmath>
#include <numeric>
#include <utility>

#include "fitter/common/parallel.h"

namespace armtrue {

std::vector<PenaltyRow> penalty_rows(const Design& design, double smoothness_sigma) {
  std::vector<PenaltyRow> rows;
  const Model& model = design.model();
  for (std::size_t u = 0; u < design.free_parameters().size(); ++u) {
    const Parameter& p = model.parameters[static_cast<std::size_t>(design.free_parameters()[u])];
    if (p.prior_sigma > 0.0)
      rows.push_back({{{static_cast<int>(u), 1.0 / p.prior_sigma}}, p.prior_mean / p.prior_sigma});
  }
  for (std::size_t j = 0; j < model.nonlinear.size(); ++j) {
    // Wide: it only keeps an unknown that no coefficient makes visible from making the system
    // singular.
    const NonlinearParameter& p = model.nonlinear[j];
    const double sigma = p.upper - p.lower;
    rows.push_back(
        {{{static_cast<int>(design.free_parameters().size() + j), 1.0 / sigma}}, p.value / sigma});
  }
  std::map<std::string, int> unknowns;
  for (std::size_t i = 0; i < model.parameters.size(); ++i)
    unknowns[model.parameters[i].name] = design.unknown_of(static_cast<int>(i));
  for (const Penalty& penalty : model.penalties) {
    const double sigma = penalty.smoothness ? penalty.sigma * smoothness_sigma : penalty.sigma;
    PenaltyRow row;
    for (const auto& [name, factor] : penalty.row) {
      if (const int unknown = unknowns.at(name); unknown >= 0)
        row.entries.emplace_back(unknown, factor / sigma);
    }
    if (!row.entries.empty()) rows.push_back(std::move(row));
  }
  return rows;
}

double PenaltyRow::residual(const std::vector<double>& values) const {
  double left = -target;
  for (const auto& [unknown, factor] : entries)
    left += factor * values[static_cast<std::size_t>(unknown)];
  return left;
}

void NormalEquations::add_gradient(const Design::Row& row, int residuals) {
  cost += row.residual.head(residuals).squaredNorm();
  equations += static_cast<std::size_t>(residuals);
  for (std::size_t b = 0; b < row.unknowns.size(); ++b) {
    gradient[row.unknowns[b]] += row.jacobian.col(static_cast<Eigen::Index>(b))
                                     .head(residuals)
                                     .dot(row.residual.head(residuals));
  }
}

void NormalEquations::add(const Design::Row& row, int residuals) {
  add_gradient(row, residuals);
  if (row.unknowns.empty()) return;
  const auto touched = static_cast<Eigen::Index>(row.unknowns.size());
  auto across = across_.topRows(touched);
  across = row.jacobian.leftCols(touched).transpose();
  // Runs of slots with consecutive unknowns: most of a row is one, the nodes of tables are pairs.
  runs_.clear();
  for (Eigen::Index a = 0; a < touched; ++a) {
    const int unknown = row.unknowns[static_cast<std::size_t>(a)];
    if (runs_.empty() || unknown != runs_.back().unknown + static_cast<int>(runs_.back().count))
      runs_.push_back({a, 0, unknown});
    ++runs_.back().count;
  }
  for (std::size_t first = 0; first < runs_.size(); ++first) {
    for (Eigen::Index k = 0; k < runs_[first].count; ++k) {
      const Eigen::Index b = runs_[first].slot + k, left = touched - b;
      const Eigen::Index ub = runs_[first].unknown + k;
      auto products = products_.head(left);
      products = across(b, 0) * across.col(0).tail(left) + across(b, 1) * across.col(1).tail(left) +
                 across(b, 2) * across.col(2).tail(left);
      for (int r = 3; r < residuals; ++r) products += across(b, r) * across.col(r).tail(left);
      information.col(ub).segment(ub, runs_[first].count - k) +=
          products.head(runs_[first].count - k);
      for (std::size_t other = first + 1; other < runs_.size(); ++other) {
        const Run& run = runs_[other];
        const auto part = products.segment(run.slot - b, run.count);
        if (run.unknown > ub) {
          information.col(ub).segment(run.unknown, run.count) += part;
        } else {
          information.row(ub).segment(run.unknown, run.count) += part.transpose();
        }
      }
    }
  }
}

void NormalEquations::add(const PenaltyRow& row, const std::vector<double>& values) {
  const double left = row.residual(values);
  for (const auto& [ua, fa] : row.entries) {
    gradient[ua] += fa * left;
    for (const auto& [ub, fb] : row.entries) {
      if (ub <= ua) information(ua, ub) += fa * fb;
    }
  }
}

EvaluatedRows evaluate_rows(const Design& design) {
  EvaluatedRows result;
  for (std::size_t i = 0; i < design.rows(); ++i) {
    if (design.weights()[i] > 0.0) result.index.push_back(i);
  }
  std::vector<Design::Row> all(design.rows());
  design.each_row(true,
                  [&](std::size_t i, Design::Row& row, const auto&) { std::swap(all[i], row); });
  for (const std::size_t i : result.index) result.rows.push_back(std::move(all[i]));
  return result;
}

NormalEquations accumulate(const Design& design, const EvaluatedRows& evaluated) {
  NormalEquations equations(design.unknowns());
  for (const Design::Row& row : evaluated.rows) equations.add(row, design.residuals_per_row());
  return equations;
}

namespace {

// Parts of the rows that are summed beside each other.
constexpr std::size_t kParts = 4;

template <typename Add>
NormalEquations accumulate_by(const Design& design, const Add& add) {
  design.basis().make_slopes();
  std::vector<NormalEquations> parts(kParts, NormalEquations(design.unknowns()));
  in_parallel(kParts, [&](std::size_t part) {
    Design::Workspace workspace(design);
    Design::Row row;
    const std::size_t end = (part + 1) * design.rows() / kParts;
    for (std::size_t i = part * design.rows() / kParts; i < end; ++i) {
      if (design.weights()[i] == 0.0) continue;
      design.evaluate(i, true, row, workspace);
      add(parts[part], row);
    }
  });
  NormalEquations& sum = parts.front();
  for (std::size_t part = 1; part < kParts; ++part) {
    sum.information += parts[part].information;
    sum.gradient += parts[part].gradient;
    sum.cost += parts[part].cost;
    sum.equations += parts[part].equations;
  }
  return std::move(sum);
}

}  // namespace

NormalEquations accumulate(const Design& design) {
  return accumulate_by(design, [&](NormalEquations& equations, const Design::Row& row) {
    equations.add(row, design.residuals_per_row());
  });
}

double squared_residuals(const Design& design) {
  std::vector<double> squares(design.rows());
  design.each_row(false, [&](std::size_t i, const Design::Row& row, const auto&) {
    squares[i] = row.residual.squaredNorm();
  });
  return std::accumulate(squares.begin(), squares.end(), 0.0);
}

NormalEquations accumulate_gradient(const Design& design) {
  return accumulate_by(design, [&](NormalEquations& equations, const Design::Row& row) {
    equations.add_gradient(row, design.residuals_per_row());
  });
}

namespace {

Eigen::VectorXd scale_of(const Eigen::MatrixXd& lower) {
  return lower.diagonal().unaryExpr([](double d) { return d > 0.0 ? 1.0 / std::sqrt(d) : 1.0; });
}

// A rounding error's worth of ridge: exact dependencies are decided before, by rank, and not here.
Eigen::MatrixXd scaled_with_ridge(const Eigen::MatrixXd& lower, const Eigen::VectorXd& scale) {
  Eigen::MatrixXd scaled = scale.asDiagonal() * lower * scale.asDiagonal();
  scaled.diagonal().array() += 1e-14;
  return scaled;
}

}  // namespace

ScaledCholesky::ScaledCholesky(const Eigen::MatrixXd& lower)
    : scale_(scale_of(lower)), factor_(scaled_with_ridge(lower, scale_)) {}

Eigen::VectorXd ScaledCholesky::solve(const Eigen::VectorXd& right) const {
  return scale_.cwiseProduct(factor_.solve(scale_.cwiseProduct(right)));
}

Eigen::MatrixXd ScaledCholesky::solve_matrix(const Eigen::MatrixXd& right) const {
  return scale_.asDiagonal() * factor_.solve_matrix(scale_.asDiagonal() * right);
}

Eigen::MatrixXd ScaledCholesky::inverse() const {
  Eigen::MatrixXd lower = factor_.lower();
  invert_cholesky(lower);
  const Eigen::MatrixXd whole = lower.selfadjointView<Eigen::Lower>();
  return scale_.asDiagonal() * whole * scale_.asDiagonal();
}

Eigen::MatrixXd ScaledCholesky::half_solve(const Eigen::MatrixXd& right) const {
  return factor_.half_solve(scale_.asDiagonal() * right);
}

double ScaledCholesky::log_determinant() const {
  return 2.0 * factor_.lower().diagonal().array().log().sum() - 2.0 * scale_.array().log().sum();
}

}  // namespace armtrue
