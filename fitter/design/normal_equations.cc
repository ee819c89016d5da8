#include "fitter/design/normal_equations.h"

#include <cmath>

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

void NormalEquations::set_zero() {
  information.setZero();
  gradient.setZero();
  cost = 0.0;
  equations = 0;
}

void NormalEquations::add(const Design::Row& row, int residuals) {
  cost += row.residual.head(residuals).squaredNorm();
  equations += static_cast<std::size_t>(residuals);
  if (row.unknowns.empty()) return;
  const auto touched = static_cast<Eigen::Index>(row.unknowns.size());
  auto across = across_.topRows(touched);
  across = row.jacobian.leftCols(touched).transpose();
  const int first = row.unknowns.front();
  bool contiguous = true;
  for (Eigen::Index a = 0; a < touched && contiguous; ++a)
    contiguous = row.unknowns[static_cast<std::size_t>(a)] == first + a;
  for (Eigen::Index b = 0; b < touched; ++b) {
    const int ub = row.unknowns[static_cast<std::size_t>(b)];
    gradient[ub] += row.jacobian.col(b).head(residuals).dot(row.residual.head(residuals));
    const Eigen::Index left = touched - b;
    auto products = products_.head(left);
    products = across(b, 0) * across.col(0).tail(left) + across(b, 1) * across.col(1).tail(left) +
               across(b, 2) * across.col(2).tail(left);
    for (int r = 3; r < residuals; ++r) products += across(b, r) * across.col(r).tail(left);
    if (contiguous) {
      information.col(ub).segment(ub, left) += products;
      continue;
    }
    for (Eigen::Index a = b; a < touched; ++a) {
      const int ua = row.unknowns[static_cast<std::size_t>(a)];
      information(std::max(ua, ub), std::min(ua, ub)) += products[a - b];
    }
  }
}

void NormalEquations::add(const PenaltyRow& row, const std::vector<double>& values) {
  double left = -row.target;
  for (const auto& [unknown, factor] : row.entries)
    left += factor * values[static_cast<std::size_t>(unknown)];
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

NormalEquations accumulate(Design& design) {
  NormalEquations equations(design.unknowns());
  Design::Row row;
  for (std::size_t i = 0; i < design.rows(); ++i) {
    if (design.weights()[i] == 0.0) continue;
    design.evaluate(i, true, row);
    equations.add(row, design.residuals_per_row());
  }
  return equations;
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
