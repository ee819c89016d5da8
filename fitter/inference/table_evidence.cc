#include "fitter/inference/table_evidence.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <string>
#include <utility>

#include "fitter/common/dense.h"
#include "fitter/common/parallel.h"

namespace armtrue {
namespace {

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

// Penalty rows of table nodes: their sum of squares at `values`, and log |P|, which is a sum over
// tables, because no row contains nodes of two tables.
struct Prior {
  double penalty = 0.0, log_determinant = 0.0;

  Prior(const Design& design, const std::vector<PenaltyRow>& rows,
        const std::vector<double>& values) {
    std::map<std::string, std::vector<PenaltyRow>> by_table;
    for (const PenaltyRow& row : rows) {
      if (!stands_on_tables(design, row)) continue;
      by_table[table_of(design, row.entries.front().first)].push_back(row);
      penalty += std::pow(row.residual(values), 2);
    }
    for (auto& [table, own] : by_table) log_determinant += log_determinant_of(std::move(own));
  }

 private:
  static std::string table_of(const Design& design, int unknown) {
    const int p = design.free_parameters()[static_cast<std::size_t>(unknown)];
    const Term& term = design.model().parameters[static_cast<std::size_t>(p)].terms.front();
    return term.table->id;
  }

  static double log_determinant_of(std::vector<PenaltyRow> rows) {
    std::map<int, int> place;  // index among the table's own, by unknown
    for (PenaltyRow& row : rows) {
      for (auto& [unknown, factor] : row.entries)
        unknown = place.try_emplace(unknown, static_cast<int>(place.size())).first->second;
    }
    NormalEquations equations(static_cast<Eigen::Index>(place.size()));
    const std::vector<double> anywhere(place.size(), 0.0);  // the information does not depend on it
    for (const PenaltyRow& row : rows) equations.add(row, anywhere);
    return ScaledCholesky(equations.information).log_determinant();
  }
};

double log_determinant(const Eigen::MatrixXd& lower, const std::vector<int>& unknowns) {
  return unknowns.empty() ? 0.0 : ScaledCholesky(lower(unknowns, unknowns)).log_determinant();
}

double occam_factor(const Split& split, const Eigen::MatrixXd& posterior,
                    const ScaledCholesky& factor, const Prior& prior) {
  return factor.log_determinant() - log_determinant(posterior, split.other) - prior.log_determinant;
}

// −2 log of the marginal likelihood of a linearised model at one smoothness of its tables.
double evidence_at(const Design& design, const NormalEquations& data, const Split& split,
                   double smoothness) {
  const std::vector<double> values = design.unknown_values();
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
  const double squares = std::max(misfit + prior.penalty, std::numeric_limits<double>::min());
  return data.equations() * std::log(squares) +
         occam_factor(split, posterior.information, factor, prior);
}

}  // namespace

TableEvidence table_evidence(const Design& design, Eigen::MatrixXd information,
                             double smoothness_sigma) {
  const Split split = split_unknowns(design);
  if (split.table.empty()) return {};
  const std::vector<PenaltyRow> rows = penalty_rows(design, smoothness_sigma);
  const std::vector<double> values = design.unknown_values();
  const Prior prior(design, rows, values);
  NormalEquations posterior(0);
  posterior.information = std::move(information);
  posterior.gradient = Eigen::VectorXd::Zero(posterior.information.rows());
  for (const PenaltyRow& row : rows) posterior.add(row, values);
  return {prior.penalty,
          occam_factor(split, posterior.information, ScaledCholesky(posterior.information), prior)};
}

const std::vector<double>& smoothnesses() {
  static const std::vector<double> tried{1e-6, 4e-6, 1e-5,   2e-5,   4e-5,
                                         7e-5, 1e-4, 1.5e-4, 2.5e-4, 5e-4};
  return tried;
}

LikeliestSmoothness likeliest_smoothness(const Design& design, const NormalEquations& data,
                                         const std::vector<double>& candidates) {
  const Split split = split_unknowns(design);
  std::vector<double> evidence(candidates.size());
  in_parallel(candidates.size(), [&](std::size_t c) {
    evidence[c] = evidence_at(design, data, split, candidates[c]);
  });
  const auto best = std::min_element(evidence.begin(), evidence.end());
  return {candidates[static_cast<std::size_t>(best - evidence.begin())], *best};
}

}  // namespace armtrue
