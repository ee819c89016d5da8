#include "fitter/solve/table_evidence.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "fitter/solve/dense.h"

namespace armtrue {
namespace {

// Of a column's own squares: keeps a block that says one thing twice from being singular.
constexpr double kRidge = 1e-7;

struct Split {
  std::vector<int> table, other;
};

Split split_unknowns(const Design& design) {
  Split split;
  for (int u = 0; u < design.unknowns(); ++u)
    (design.is_table_unknown(u) ? split.table : split.other).push_back(u);
  return split;
}

bool stands_on_tables(const Design& design, const PenaltyRow& row) {
  return std::all_of(row.entries.begin(), row.entries.end(),
                     [&](const auto& entry) { return design.is_table_unknown(entry.first); });
}

// Penalty rows of table nodes: their information, and their sum of squares at `values`.
struct Prior {
  NormalEquations equations;
  double penalty = 0.0;

  Prior(const Design& design, const std::vector<PenaltyRow>& rows,
        const std::vector<double>& values)
      : equations(design.unknowns()) {
    for (const PenaltyRow& row : rows) {
      if (!stands_on_tables(design, row)) continue;
      equations.add(row, values);
      double left = -row.target;
      for (const auto& [unknown, factor] : row.entries)
        left += factor * values[static_cast<std::size_t>(unknown)];
      penalty += left * left;
    }
  }
};

double log_determinant(const Eigen::MatrixXd& lower, const std::vector<int>& unknowns) {
  return unknowns.empty() ? 0.0 : ScaledCholesky(lower(unknowns, unknowns)).log_determinant();
}

double occam_factor(const Split& split, const Eigen::MatrixXd& posterior,
                    const ScaledCholesky& factor, const Eigen::MatrixXd& prior) {
  return factor.log_determinant() - log_determinant(posterior, split.other) -
         log_determinant(prior, split.table);
}

// A linearised model at one smoothness of its tables.
struct Smoothed {
  double smoothness;
  const ScaledCholesky& factor;  // of the information with all penalties
  const Eigen::VectorXd& step;   // to the best solution
  double squares;                // misfit there and penalties of tables
  double occam, equations;

  // −2 log of the marginal likelihood where so many squares less were left.
  double evidence(double gain) const {
    return equations * std::log(std::max(squares - gain, std::numeric_limits<double>::min())) +
           occam;
  }
};

template <typename Visit>
void for_each_smoothness(const Design& design, const NormalEquations& data,
                         const std::vector<double>& candidates, const Visit& visit) {
  const Split split = split_unknowns(design);
  const std::vector<double> values = design.unknown_values();
  for (const double smoothness : candidates) {
    NormalEquations posterior = data;
    const std::vector<PenaltyRow> rows = penalty_rows(design, smoothness);
    for (const PenaltyRow& row : rows) posterior.add(row, values);
    const ScaledCholesky factor(posterior.information);
    const Eigen::VectorXd step = -factor.solve(posterior.gradient);
    const double misfit = data.cost + 2.0 * data.gradient.dot(step) +
                          step.dot(data.information.selfadjointView<Eigen::Lower>() * step);
    std::vector<double> solution = values;
    for (std::size_t u = 0; u < solution.size(); ++u)
      solution[u] += step[static_cast<Eigen::Index>(u)];
    const Prior prior(design, rows, solution);
    visit(Smoothed{smoothness, factor, step, misfit + prior.penalty,
                   occam_factor(split, posterior.information, factor, prior.equations.information),
                   static_cast<double>(data.equations)});
  }
}

}  // namespace

TableEvidence table_evidence(const Design& design, const Eigen::MatrixXd& information,
                             double smoothness_sigma) {
  const Split split = split_unknowns(design);
  if (split.table.empty()) return {};
  const std::vector<PenaltyRow> rows = penalty_rows(design, smoothness_sigma);
  const std::vector<double> values = design.unknown_values();
  const Prior prior(design, rows, values);
  NormalEquations posterior(information.rows());
  posterior.information = information.triangularView<Eigen::Lower>();
  for (const PenaltyRow& row : rows) posterior.add(row, values);
  return {prior.penalty,
          occam_factor(split, posterior.information, ScaledCholesky(posterior.information),
                       prior.equations.information)};
}

const std::vector<double>& smoothnesses() {
  static const std::vector<double> tried{1e-6, 4e-6, 1e-5,   2e-5,   4e-5,
                                         7e-5, 1e-4, 1.5e-4, 2.5e-4, 5e-4};
  return tried;
}

LikeliestSmoothness likeliest_smoothness(const Design& design, const NormalEquations& data,
                                         const std::vector<double>& candidates) {
  LikeliestSmoothness likeliest{candidates.front(), std::numeric_limits<double>::infinity()};
  for_each_smoothness(design, data, candidates, [&](const Smoothed& smoothed) {
    if (smoothed.evidence(0.0) < likeliest.evidence)
      likeliest = {smoothed.smoothness, smoothed.evidence(0.0)};
  });
  return likeliest;
}

std::vector<double> bic_changes_beside_tables(const Design& design, const EvaluatedRows& evaluated,
                                              const Eigen::MatrixXd& columns,
                                              const std::vector<Eigen::Index>& widths,
                                              const std::vector<double>& candidates) {
  const Eigen::Index height = design.residuals_per_row();
  const NormalEquations data = accumulate(design, evaluated);
  const Eigen::MatrixXd across = columns.transpose();
  Eigen::VectorXd own_gradient = Eigen::VectorXd::Zero(columns.cols());
  Eigen::MatrixXd shared = Eigen::MatrixXd::Zero(columns.cols(), design.unknowns());
  for (std::size_t r = 0; r < evaluated.rows.size(); ++r) {
    const Design::Row& row = evaluated.rows[r];
    const auto own = across.middleCols(static_cast<Eigen::Index>(r) * height, height);
    own_gradient += own * row.residual.head(height);
    for (std::size_t u = 0; u < row.unknowns.size(); ++u) {
      shared.col(row.unknowns[u]).noalias() +=
          own * row.jacobian.col(static_cast<Eigen::Index>(u)).head(height);
    }
  }
  const double charge = std::log(static_cast<double>(data.equations));
  double without = std::numeric_limits<double>::infinity();
  std::vector<double> with(widths.size(), without);
  for_each_smoothness(design, data, candidates, [&](const Smoothed& smoothed) {
    without = std::min(without, smoothed.evidence(0.0));
    const Eigen::MatrixXd half = smoothed.factor.half_solve(shared.transpose());
    const Eigen::VectorXd gradient = own_gradient + shared * smoothed.step;
    Eigen::Index first = 0;
    for (std::size_t b = 0; b < widths.size(); ++b) {
      const Eigen::Index width = widths[b];
      const auto own = columns.middleCols(first, width);
      const auto explained = half.middleCols(first, width);
      Eigen::MatrixXd left = square(own);
      left.diagonal() *= 1.0 + kRidge;
      left -= square(explained);
      const ScaledCholesky factor(left);
      if (factor.ok()) {
        const double gain = factor.half_solve(gradient.segment(first, width)).squaredNorm();
        with[b] = std::min(with[b], smoothed.evidence(gain) + charge * static_cast<double>(width));
      }
      first += width;
    }
  });
  for (double& value : with) value -= without;
  return with;
}

}  // namespace armtrue
