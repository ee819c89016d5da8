#include "fitter/inference/uncertainty.h"

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "fitter/common/dense.h"
#include "fitter/inference/replicates.h"

namespace armtrue {
namespace {

constexpr int kVariancePasses = 6;
constexpr double kSpreadSettled = 1e-3;   // of the equations
constexpr double kLearntInFull = 1e-300;  // variance over that before; its logarithm is finite

// The unknowns' covariance: what the measurements say, in `equations`, and the penalties.
Eigen::MatrixXd inverse_with_penalties(const Design& design, double smoothness_sigma,
                                       NormalEquations& equations) {
  const std::vector<double> values = design.unknown_values();
  for (const PenaltyRow& row : penalty_rows(design, smoothness_sigma)) equations.add(row, values);
  return ScaledCholesky(equations.information).inverse();
}

struct Spread {
  Eigen::MatrixXd covariance;
  Eigen::MatrixXd data;  // JᵀJ in units of the residuals' variance
  double effective_unknowns = 0.0;
};

// What priors and smoothness hold is no unknown, and how much that is depends on the residuals'
// variance, which depends on the number of unknowns in turn.
Spread spread_of(const Design& design, const NormalEquations& equations, double smoothness_sigma,
                 double guess) {
  const Eigen::MatrixXd whole = equations.information.selfadjointView<Eigen::Lower>();
  const double count = equations.equations();
  Spread spread;
  spread.effective_unknowns =
      std::min(guess > 0.0 ? guess : static_cast<double>(design.unknowns()), 0.5 * count);
  for (int pass = 0; pass < kVariancePasses; ++pass) {
    const double variance =
        std::max(equations.cost / std::max(1.0, count - spread.effective_unknowns), 1e-12);
    spread.data = whole / variance;
    NormalEquations scaled = equations;
    scaled.information /= variance;
    spread.covariance = inverse_with_penalties(design, smoothness_sigma, scaled);
    const double before =
        std::exchange(spread.effective_unknowns, spread.covariance.cwiseProduct(spread.data).sum());
    if (std::abs(before - spread.effective_unknowns) < kSpreadSettled * count) break;
  }
  return spread;
}

// What the shots of one visit share makes coefficients less sure than as many visits would.
void count_repeats(const Design& design, const EvaluatedRows& evaluated, double smoothness_sigma,
                   Spread& spread) {
  const std::size_t rows = evaluated.rows.size();
  const Replicates replicates(design.measurements(), evaluated.index);
  if (!replicates.any()) return;
  const int height = design.residuals_per_row();
  Eigen::VectorXd residual(static_cast<Eigen::Index>(rows) * height);
  for (std::size_t r = 0; r < rows; ++r) {
    residual.segment(static_cast<Eigen::Index>(r) * height, height) =
        evaluated.rows[r].residual.head(height);
  }
  const double correlation = replicates.correlation(residual, height);
  if (correlation <= 0.0) return;
  const std::vector<double> worth = replicates.worth(correlation);
  EvaluatedRows weighed = evaluated;
  double design_effect = 0.0;
  for (std::size_t r = 0; r < rows; ++r) {
    weighed.rows[r].jacobian *= std::sqrt(worth[r]);
    design_effect += 1.0 / worth[r] / static_cast<double>(rows);
  }
  NormalEquations equations = accumulate(design, weighed);
  const double freedom =
      std::max(1.0, equations.equations() - spread.effective_unknowns * design_effect);
  equations.information /= std::max(residual.squaredNorm() / freedom, 1e-12);
  spread.covariance = inverse_with_penalties(design, smoothness_sigma, equations);
}

Eigen::VectorXd what_was_learnt(const Design& design, const Eigen::MatrixXd& covariance) {
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
    // What has no prior is learnt without limit.
    one_over_prior.push_back(prior > 0.0 ? 1.0 / prior : 0.0);
  }
  const Eigen::Map<const Eigen::VectorXd> scale(one_over_prior.data(),
                                                static_cast<Eigen::Index>(one_over_prior.size()));
  const Eigen::MatrixXd shrunk =
      scale.asDiagonal() * covariance(outside, outside) * scale.asDiagonal();
  return -symmetric_eigenvalues(shrunk).array().max(kLearntInFull).log();
}

}  // namespace

double Uncertainty::charge_for_unknowns(double coordinates) const {
  const double most = std::log(coordinates);
  return tables.occam + learnt.array().max(0.0).min(most).sum();
}

double count_effective_unknowns(const Design& design, const NormalEquations& equations,
                                double smoothness_sigma, double guess) {
  return spread_of(design, equations, smoothness_sigma, guess).effective_unknowns;
}

Uncertainty measure_uncertainty(const Design& design, const EvaluatedRows& evaluated,
                                double smoothness_sigma, double guess) {
  Spread spread = spread_of(design, accumulate(design, evaluated), smoothness_sigma, guess);
  const TableEvidence tables = table_evidence(design, spread.data, smoothness_sigma);
  count_repeats(design, evaluated, smoothness_sigma, spread);
  Eigen::VectorXd learnt = what_was_learnt(design, spread.covariance);
  return {std::move(spread.covariance), spread.effective_unknowns, std::move(learnt), tables};
}

}  // namespace armtrue
