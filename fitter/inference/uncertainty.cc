#include "fitter/inference/uncertainty.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>
#include <vector>

#include "fitter/common/dense.h"
#include "fitter/inference/replicates.h"
#include "fitter/inference/scatter_parts.h"

namespace armtrue {
namespace {

constexpr int kVariancePasses = 6;
constexpr double kSpreadSettled = 1e-3;  // relative to the number of equations
// Least degrees of freedom per part of the scatter: with fewer, the scatter of one joint could
// explain all equations.
constexpr double kEquationsPerPart = 4.0;
constexpr double kLearntInFull = 1e-300;  // least variance ratio; its logarithm is finite

ScaledCholesky factor_with_penalties(NormalEquations equations,
                                     const std::vector<PenaltyRow>& penalties,
                                     const std::vector<double>& values) {
  for (const PenaltyRow& row : penalties) equations.add(row, values);
  return ScaledCholesky(std::move(equations.information));
}

// Number of unknowns that the data determine: the trace of C (C⁻¹ − P), where C = WᵀW is the
// covariance and P the information of the penalties. `root`: W, a lower triangle.
double count_learnt(const Eigen::MatrixXd& root, const std::vector<PenaltyRow>& penalties) {
  double held = 0.0;
  Eigen::VectorXd moved(root.rows());
  for (const PenaltyRow& row : penalties) {
    moved.setZero();
    for (const auto& [unknown, factor] : row.entries) {
      const Eigen::Index below = root.rows() - unknown;
      moved.tail(below) += factor * root.col(unknown).tail(below);
    }
    held += moved.squaredNorm();
  }
  return static_cast<double>(root.rows()) - held;
}

// Uncertainty of the unknowns from the measurements.
struct Spread {
  Eigen::MatrixXd root;   // a lower triangle W; the covariance is WᵀW
  double variance = 1.0;  // of the residuals
  double effective_unknowns = 0.0;
};

// The number of effective unknowns depends on the residuals' variance and the variance on this
// number, so both are iterated.
Spread spread_of(const Design& design, const NormalEquations& equations,
                 const std::vector<PenaltyRow>& penalties, double guess) {
  const std::vector<double> values = design.unknown_values();
  const double count = equations.equations();
  Spread spread;
  spread.effective_unknowns =
      std::min(guess > 0.0 ? guess : static_cast<double>(design.unknowns()), 0.5 * count);
  for (int pass = 0; pass < kVariancePasses; ++pass) {
    spread.variance =
        std::max(equations.cost / std::max(1.0, count - spread.effective_unknowns), 1e-12);
    NormalEquations scaled = equations;
    scaled.information /= spread.variance;
    spread.root = factor_with_penalties(std::move(scaled), penalties, values).inverse_root();
    const double before =
        std::exchange(spread.effective_unknowns, count_learnt(spread.root, penalties));
    if (std::abs(before - spread.effective_unknowns) < kSpreadSettled * count) break;
  }
  return spread;
}

// Spread::root with repeated readings weighted down for the error that they share. Empty if no pose
// was repeated, or repeats are uncorrelated.
std::optional<Eigen::MatrixXd> root_with_repeats(const Design& design,
                                                 const EvaluatedRows& evaluated,
                                                 const std::vector<PenaltyRow>& penalties,
                                                 double effective_unknowns) {
  const std::size_t rows = evaluated.rows.size();
  const Replicates replicates(design.measurements(), evaluated.index);
  if (!replicates.any()) return std::nullopt;
  const int height = design.residuals_per_row();
  Eigen::VectorXd residual(static_cast<Eigen::Index>(rows) * height);
  for (std::size_t r = 0; r < rows; ++r) {
    residual.segment(static_cast<Eigen::Index>(r) * height, height) =
        evaluated.rows[r].residual.head(height);
  }
  const double correlation = replicates.correlation(residual, height);
  if (correlation <= 0.0) return std::nullopt;
  const std::vector<double> worth = replicates.worth(correlation);
  EvaluatedRows weighed = evaluated;
  double design_effect = 0.0;
  for (std::size_t r = 0; r < rows; ++r) {
    weighed.rows[r].jacobian *= std::sqrt(worth[r]);
    design_effect += 1.0 / worth[r] / static_cast<double>(rows);
  }
  NormalEquations equations = accumulate(design, weighed);
  const double freedom = std::max(1.0, equations.equations() - effective_unknowns * design_effect);
  equations.information /= std::max(residual.squaredNorm() / freedom, 1e-12);
  return factor_with_penalties(std::move(equations), penalties, design.unknown_values())
      .inverse_root();
}

// Uncertainty::learnt. `root`: of the covariance, as Spread::root.
Eigen::VectorXd what_was_learnt(const Design& design, const Eigen::MatrixXd& root) {
  std::vector<int> outside;
  std::vector<double> one_over_prior;
  const std::vector<int>& linear = design.free_parameters();
  for (int u = 0; u < design.unknowns(); ++u) {
    if (design.is_table_unknown(u)) continue;
    const auto at = static_cast<std::size_t>(u);
    const double prior =
        at < linear.size()
            ? design.model().parameters[static_cast<std::size_t>(linear[at])].prior_sigma
            : 0.0;
    outside.push_back(u);
    // Without a prior, the data's contribution has no limit.
    one_over_prior.push_back(prior > 0.0 ? 1.0 / prior : 0.0);
  }
  Eigen::MatrixXd shrunk =
      Eigen::MatrixXd::Zero(root.rows(), static_cast<Eigen::Index>(outside.size()));
  for (std::size_t i = 0; i < outside.size(); ++i) {
    const Eigen::Index below = root.rows() - outside[i];
    shrunk.col(static_cast<Eigen::Index>(i)).tail(below) =
        one_over_prior[i] * root.col(outside[i]).tail(below);
  }
  return -symmetric_eigenvalues(square(shrunk)).array().max(kLearntInFull).log();
}

}  // namespace

double Uncertainty::charge_for_unknowns(double coordinates) const {
  const double most = std::log(coordinates);
  return tables.occam + learnt.array().max(0.0).min(most).sum();
}

double count_effective_unknowns(const Design& design, const NormalEquations& equations,
                                double smoothness_sigma, double guess) {
  return spread_of(design, equations, penalty_rows(design, smoothness_sigma), guess)
      .effective_unknowns;
}

Uncertainty measure_uncertainty(const Design& design, const EvaluatedRows& evaluated,
                                double smoothness_sigma, double guess) {
  const std::vector<PenaltyRow> penalties = penalty_rows(design, smoothness_sigma);
  NormalEquations equations = accumulate(design, evaluated);
  Spread spread = spread_of(design, equations, penalties, guess);
  equations.information /= spread.variance;
  const TableEvidence tables =
      table_evidence(design, std::move(equations.information), smoothness_sigma);
  const std::optional<Eigen::MatrixXd> with_repeats =
      root_with_repeats(design, evaluated, penalties, spread.effective_unknowns);
  Eigen::VectorXd learnt = what_was_learnt(design, with_repeats ? *with_repeats : spread.root);
  return {spread.effective_unknowns, std::move(learnt), tables};
}

Eigen::MatrixXd covariance_of(const Design& design, double smoothness_sigma, double guess) {
  const EvaluatedRows evaluated = evaluate_rows(design);
  const std::vector<PenaltyRow> penalties = penalty_rows(design, smoothness_sigma);
  const NormalEquations equations = accumulate(design, evaluated);
  Spread spread = spread_of(design, equations, penalties, guess);
  Eigen::MatrixXd covariance = square_of_triangle(std::move(spread.root));
  const double left = equations.equations() - spread.effective_unknowns;
  if (left < kEquationsPerPart * (design.kinematics().layout().joints + 1)) return covariance;
  return with_scatter_in_parts(design, evaluated, penalties, std::move(covariance),
                               spread.variance);
}

}  // namespace armtrue
