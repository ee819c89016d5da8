#include "fitter/evidence/search/conditional.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "fitter/common/dense.h"

namespace armtrue {
namespace {

double log_normal_cdf(double z) {
  if (z > -8.0) return std::log(0.5 * std::erfc(-z / std::sqrt(2.0)));
  return -0.5 * z * z - std::log(-z) - 0.9189385332046727;
}

// An effect carries its load if its cosine with the load is at most −kCarries, whatever else its
// shape does. With a cosine above 0 the terms are hardly this effect.
constexpr double kCarries = 0.5;
constexpr double kHardly = 10.0;       // log odds
constexpr double kLeastCarried = 0.1;  // of the load's own deflection: less is not worth building
// A third of waves with random phase act against their load that well, so those that do are three
// times as probable.
constexpr double kCarrySeldom = 1.0986122886681098;  // log 3

double carrying_term(const Carrying& carrying, const Eigen::VectorXd& coefficient) {
  const double size = std::sqrt(coefficient.dot(carrying.square * coefficient));
  if (size <= 0.0) return 0.0;
  const double cosine = coefficient.dot(carrying.along) / size;
  const double share = carrying.yields > 0.0 ? size / carrying.yields : 1.0;
  return -kHardly * std::max(std::clamp(1.0 + cosine / kCarries, 0.0, 1.0),
                             std::clamp(1.0 - share / kLeastCarried, 0.0, 1.0));
}

// Log of the factor by which the sign rules change the evidence: the posterior probability that
// each rule is met over the prior one, ½. With the prior's variance `square` and the Cholesky
// factor L of (posterior precision × square), `half` is L⁻¹ × gradient, and column i of `own` is
// L⁻¹ × the combination of coefficients in rule i.
double sign_term(const std::vector<SignRule>& rules, const Eigen::Ref<const Eigen::VectorXd>& half,
                 const Eigen::Ref<const Eigen::MatrixXd>& own, double square, double noise) {
  double sum = 0.0;
  for (std::size_t i = 0; i < rules.size(); ++i) {
    const auto along = own.col(static_cast<Eigen::Index>(i));
    const double spread = std::sqrt(noise * square * along.squaredNorm());
    if (spread <= 0.0) continue;
    const double z = square * along.dot(half) / spread;
    const SignRule& rule = rules[i];
    std::vector<double> ways{std::log1p(-rule.doubt) + log_normal_cdf(z)};
    if (rule.doubt > 0.0) ways.push_back(std::log(rule.doubt) + log_normal_cdf(-z));
    sum += std::log(2.0) + log_sum(ways);
  }
  return sum;
}

void weigh_shape(const SearchProblem& problem, const SearchBlock& own,
                 const Elimination::Local& local, int index, Conditional& result) {
  const PriorShape& shape = own.shapes[static_cast<std::size_t>(index)];
  const Eigen::MatrixXd inner = congruent(local.gram, shape.spread);
  const auto rules = static_cast<Eigen::Index>(shape.signs.size());
  Eigen::MatrixXd right(inner.rows(), 1 + rules);
  right.col(0) = shape.spread.transpose() * local.gradient;
  for (Eigen::Index i = 0; i < rules; ++i)
    right.col(1 + i) = shape.units.transpose() * shape.signs[static_cast<std::size_t>(i)].along;
  for (std::size_t s = 0; s < shape.scale.size(); ++s) {
    const double square = shape.scale[s] * shape.scale[s];
    Eigen::MatrixXd root = square * inner;
    root.diagonal().array() += 1.0;
    result.choices.push_back({index, static_cast<int>(s)});
    // Rounding can make the matrix indefinite if another block already explains the same.
    const Cholesky factor(std::move(root));
    if (!factor.ok()) {
      result.log_weight.push_back(-std::numeric_limits<double>::infinity());
      result.log_physics.push_back(0.0);
      continue;
    }
    const Eigen::MatrixXd half = factor.half_solve(right);
    const double left = local.squares - square * half.col(0).squaredNorm();
    double physics = 0.0;
    if (!shape.carries.empty()) {
      Eigen::MatrixXd solution = half.col(0);
      solve_lower_transposed(factor.lower(), solution);
      physics +=
          kCarrySeldom + carrying_term(shape.carries.front(), square * (shape.units * solution));
    }
    if (rules > 0) {
      const double noise = std::max(left, 1e-9) / std::max(1.0, problem.freedom);
      physics += sign_term(shape.signs, half.col(0), half.rightCols(rules), square, noise);
    }
    const double weight = own.log_odds + shape.log_prior[s] -
                          factor.lower().diagonal().array().log().sum() + fit_term(problem, left);
    result.log_weight.push_back(weight + physics);
    result.log_physics.push_back(physics);
  }
}

}  // namespace

double log_sum(const std::vector<double>& terms) {
  const double most = *std::max_element(terms.begin(), terms.end());
  double sum = 0.0;
  for (const double t : terms) sum += std::exp(t - most);
  return most + std::log(sum);
}

double fit_term(const SearchProblem& problem, double squares) {
  const double scaled = 0.5 * (problem.prior_freedom + std::max(squares, 1e-9));
  return -0.5 * (problem.freedom + problem.prior_freedom) * std::log(scaled);
}

Conditional weigh_choices(const SearchProblem& problem, const SearchBlock& block,
                          const Elimination::Local& local) {
  Conditional result{{Choice{}}, {fit_term(problem, local.squares)}, {0.0}};
  for (std::size_t i = 0; i < block.shapes.size(); ++i)
    weigh_shape(problem, block, local, static_cast<int>(i), result);
  return result;
}

}  // namespace armtrue
