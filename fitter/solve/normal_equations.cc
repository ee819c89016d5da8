#include "fitter/solve/normal_equations.h"

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

void NormalEquations::add(const Design::Row& row, int residuals) {
  const auto touched = static_cast<Eigen::Index>(row.unknowns.size());
  for (Eigen::Index a = 0; a < touched; ++a) {
    const int ua = row.unknowns[static_cast<std::size_t>(a)];
    gradient[ua] += row.jacobian.col(a).head(residuals).dot(row.residual.head(residuals));
    for (Eigen::Index b = 0; b <= a; ++b) {
      const int ub = row.unknowns[static_cast<std::size_t>(b)];
      information(std::max(ua, ub), std::min(ua, ub)) +=
          row.jacobian.col(a).head(residuals).dot(row.jacobian.col(b).head(residuals));
    }
  }
  const double square = row.residual.head(residuals).squaredNorm();
  cost += square;
  equations += static_cast<std::size_t>(residuals);
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

ScaledCholesky::ScaledCholesky(const Eigen::MatrixXd& lower) : scale_(lower.rows()) {
  for (Eigen::Index i = 0; i < lower.rows(); ++i) {
    scale_[i] = lower(i, i) > 0.0 ? 1.0 / std::sqrt(lower(i, i)) : 1.0;
  }
  Eigen::MatrixXd scaled = scale_.asDiagonal() * lower * scale_.asDiagonal();
  // A rounding error's worth of ridge: exact dependencies are decided before, by rank, and not
  // here.
  scaled.diagonal().array() += 1e-14;
  factor_.compute(scaled.selfadjointView<Eigen::Lower>());
}

Eigen::VectorXd ScaledCholesky::solve(const Eigen::VectorXd& right) const {
  return scale_.cwiseProduct(factor_.solve(scale_.cwiseProduct(right)));
}

Eigen::MatrixXd ScaledCholesky::solve_matrix(const Eigen::MatrixXd& right) const {
  return scale_.asDiagonal() * factor_.solve(scale_.asDiagonal() * right);
}

Eigen::MatrixXd ScaledCholesky::inverse() const {
  const Eigen::Index n = scale_.size();
  return scale_.asDiagonal() * factor_.solve(Eigen::MatrixXd::Identity(n, n)) * scale_.asDiagonal();
}

Eigen::MatrixXd ScaledCholesky::half_solve(const Eigen::MatrixXd& right) const {
  return factor_.matrixL().solve(scale_.asDiagonal() * right);
}

double ScaledCholesky::log_determinant() const {
  return 2.0 * factor_.matrixLLT().diagonal().array().log().sum() -
         2.0 * scale_.array().log().sum();
}

}  // namespace armtrue
