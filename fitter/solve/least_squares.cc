#include "fitter/solve/least_squares.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <utility>

#include "fitter/design/normal_equations.h"

namespace armtrue {
namespace {

constexpr int kMostSteps = 50;
// The solution has converged if a step lowers the cost by less than this share,
constexpr double kSettled = 1e-9, kSettledOnTheWay = 1e-3;
// or if it is shorter than this share of the unknowns.
constexpr double kShortestStep = 1e-9;
// A factor is used for further steps while each predicts less than this share of the last step's
// gain: 1 mm turns the Jacobian of an arm of 1 m by a thousandth.
constexpr double kKeepsConverging = 0.1;
// Damping in units of the information's diagonal: none while the cost falls. The first value is
// below the rounding error of directions that the data hardly determine, because it is these that
// overshoot.
constexpr double kLeastDamping = 1e-12, kMostDamping = 1e12;

// Levenberg and Marquardt's method (Nocedal and Wright, Numerical Optimization, 10.3):
// Gauss–Newton steps, shortened where they would raise the cost by adding a multiple of JᵀJ's
// diagonal to JᵀJ.
class Descent {
 public:
  Descent(Design& design, const std::vector<PenaltyRow>& penalties)
      : design_(design),
        penalties_(penalties),
        values_(design.unknown_values()),
        cost_(cost_at(values_)) {}

  SolveSummary run(double settled) {
    SolveSummary summary;
    while (!summary.converged && summary.iterations < kMostSteps) {
      ++summary.iterations;
      summary.converged = step(settled);
    }
    design_.set_unknowns(values_.data());
    summary.cost = cost_;
    if (!summary.converged)
      summary.message = "after " + std::to_string(kMostSteps) + " steps the cost still falls";
    return summary;
  }

 private:
  // Returns true if the solution has converged.
  bool step(double settled) {
    design_.set_unknowns(values_.data());
    const bool is_stale = factor_ && renew_gradient();
    if (!is_stale) factorise();
    if (!factor_->ok()) return damp();
    const Eigen::VectorXd change = -factor_->solve(gradient_);
    const double promise = -gradient_.dot(change);
    if (is_stale && !(promise < kKeepsConverging * promised_)) {
      forget();
      return false;
    }
    promised_ = promise;
    const std::vector<double> moved = within_bounds(change);
    const double cost = cost_at(moved);
    if (cost > cost_) {
      if (is_stale) {
        forget();
        return false;
      }
      // If rounding errors exceed the remaining gain, no step lowers the cost.
      return damp() || promise <= settled * cost_ || is_short(change);
    }
    const double gain = cost_ - cost;
    values_ = moved;
    cost_ = cost;
    is_linearised_ = false;
    if (damping_ > 0.0) relax(gain / promise);
    return gain <= settled * cost || is_short(change);
  }

  void forget() {
    factor_.reset();
    is_linearised_ = false;
  }

  // Returns true if no damping helps.
  bool damp() {
    factor_.reset();
    damping_ = damping_ > 0.0 ? growth_ * damping_ : kLeastDamping;
    growth_ *= 2.0;
    return damping_ > kMostDamping;
  }

  // Less damping the closer the gain came to the prediction (Nielsen 1999, IMM-REP-1999-05, 2.2).
  void relax(double kept) {
    factor_.reset();
    growth_ = 2.0;
    damping_ *= std::max(1.0 / 3.0, 1.0 - std::pow(2.0 * kept - 1.0, 3));
    if (damping_ < kLeastDamping) damping_ = 0.0;
  }

  // Of measurements and penalties; infinity if it is not a finite number.
  double cost_at(const std::vector<double>& values) {
    design_.set_unknowns(values.data());
    double sum = squared_residuals(design_);
    for (const PenaltyRow& row : penalties_) sum += std::pow(row.residual(values), 2);
    return std::isfinite(sum) ? sum : std::numeric_limits<double>::infinity();
  }

  // Returns false if the unknowns held by bounds are not those of the factor.
  bool renew_gradient() {
    gradient_ = gradient_of(design_);
    for (const PenaltyRow& row : penalties_) {
      const double left = row.residual(values_);
      for (const auto& [unknown, factor] : row.entries) gradient_[unknown] += factor * left;
    }
    const std::vector<int> held = held_by_bounds();
    for (const int unknown : held) gradient_[unknown] = 0.0;
    return held == held_;
  }

  // At the present values, with the present damping.
  void factorise() {
    if (!is_linearised_) linearise();
    Eigen::MatrixXd damped = information_;
    damped.diagonal() *= 1.0 + damping_;
    factor_.emplace(damped);
  }

  void linearise() {
    NormalEquations equations = accumulate(design_);
    for (const PenaltyRow& row : penalties_) equations.add(row, values_);
    gradient_ = equations.gradient;
    held_ = held_by_bounds();
    information_ = std::move(equations.information);
    for (const int unknown : held_) {
      gradient_[unknown] = 0.0;
      information_.row(unknown).setZero();
      information_.col(unknown).setZero();
      information_(unknown, unknown) = 1.0;
    }
    is_linearised_ = true;
  }

  // Nonlinear parameters at a bound that a descent step would cross.
  std::vector<int> held_by_bounds() const {
    std::vector<int> held;
    for (int j = 0; j < design_.nonlinear_count(); ++j) {
      const NonlinearParameter& p = design_.model().nonlinear[static_cast<std::size_t>(j)];
      const int unknown = first_nonlinear() + j;
      const double value = values_[static_cast<std::size_t>(unknown)];
      if ((value <= p.lower && gradient_[unknown] > 0.0) ||
          (value >= p.upper && gradient_[unknown] < 0.0))
        held.push_back(unknown);
    }
    return held;
  }

  std::vector<double> within_bounds(const Eigen::VectorXd& change) const {
    std::vector<double> moved = values_;
    for (std::size_t u = 0; u < moved.size(); ++u) moved[u] += change[static_cast<Eigen::Index>(u)];
    for (int j = 0; j < design_.nonlinear_count(); ++j) {
      const NonlinearParameter& p = design_.model().nonlinear[static_cast<std::size_t>(j)];
      double& value = moved[static_cast<std::size_t>(first_nonlinear() + j)];
      value = std::clamp(value, p.lower, p.upper);
    }
    return moved;
  }

  int first_nonlinear() const { return design_.unknowns() - design_.nonlinear_count(); }

  bool is_short(const Eigen::VectorXd& change) const {
    const Eigen::Map<const Eigen::VectorXd> values(values_.data(), change.size());
    return change.norm() <= kShortestStep * values.norm();
  }

  Design& design_;
  const std::vector<PenaltyRow>& penalties_;
  std::vector<double> values_;
  double cost_;
  Eigen::VectorXd gradient_;
  Eigen::MatrixXd information_;
  bool is_linearised_ = false;            // information_ is that of values_
  std::vector<int> held_;                 // by bounds, in the information
  std::optional<ScaledCholesky> factor_;  // none: the next step needs a new one
  double promised_ = 0.0;                 // gain that the previous step predicted
  double damping_ = 0.0, growth_ = 2.0;   // growth_: factor on it if the next step fails
};

}  // namespace

SolveSummary solve(Design& design, double smoothness_sigma, Accuracy accuracy) {
  if (design.unknowns() == 0) return {0, true, 0.0, "nothing to solve for"};
  const std::vector<PenaltyRow> penalties = penalty_rows(design, smoothness_sigma);
  return Descent(design, penalties).run(accuracy == Accuracy::kFull ? kSettled : kSettledOnTheWay);
}

}  // namespace armtrue
