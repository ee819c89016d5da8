#include "fitter/solve/least_squares.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>

#include "fitter/design/normal_equations.h"

namespace armtrue {
namespace {

constexpr int kMostSteps = 50;
// Share of the cost that a step must gain for another one to follow.
constexpr double kSettled = 1e-9, kSettledOnTheWay = 1e-3;
// A step this much shorter than the unknowns themselves is the last one.
constexpr double kShortestStep = 1e-9;
// A factor serves for further steps while each promises less than this share of what the step
// before did: a millimetre turns the Jacobian of a metre's arm by a thousandth.
constexpr double kKeepsConverging = 0.1;
// Damping in units of the information's diagonal: none while the cost falls.
constexpr double kFirstDamping = 1e-4, kDampingStep = 10.0, kMostDamping = 1e12;

// Gauss–Newton steps on the normal equations, damped by the information's diagonal where they do
// not descend (Levenberg and Marquardt; Nocedal and Wright, Numerical Optimization, 10.3).
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
  // True where nothing is left to gain.
  bool step(double settled) {
    design_.set_unknowns(values_.data());
    const bool is_stale = factor_ && renew_gradient();
    if (!is_stale) linearise();
    if (!factor_->ok()) return damp();
    const Eigen::VectorXd change = -factor_->solve(gradient_);
    const double promise = -gradient_.dot(change);
    if (is_stale && !(promise < kKeepsConverging * promised_)) {
      factor_.reset();
      return false;
    }
    promised_ = promise;
    const std::vector<double> moved = within_bounds(change);
    const double cost = cost_at(moved);
    if (cost <= cost_) {
      const bool is_last = cost_ - cost <= settled * cost || is_short(change);
      values_ = moved;
      cost_ = cost;
      if (damping_ > 0.0) factor_.reset();
      damping_ = damping_ > kFirstDamping ? damping_ / kDampingStep : 0.0;
      return is_last;
    }
    if (is_stale) {
      factor_.reset();
      return false;
    }
    // Where rounding is all that is left to gain, no step descends.
    return damp() || promise <= settled * cost_ || is_short(change);
  }

  // True where no damping helps.
  bool damp() {
    factor_.reset();
    damping_ = std::max(kFirstDamping, kDampingStep * damping_);
    return damping_ > kMostDamping;
  }

  // Of measurements and penalties; infinite where it is no number.
  double cost_at(const std::vector<double>& values) {
    design_.set_unknowns(values.data());
    double sum = squared_residuals(design_);
    for (const PenaltyRow& row : penalties_) sum += std::pow(row.residual(values), 2);
    return std::isfinite(sum) ? sum : std::numeric_limits<double>::infinity();
  }

  // False where other unknowns are held than in the factor.
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

  void linearise() {
    NormalEquations equations = accumulate(design_);
    for (const PenaltyRow& row : penalties_) equations.add(row, values_);
    gradient_ = equations.gradient;
    held_ = held_by_bounds();
    Eigen::MatrixXd& information = equations.information;
    for (const int unknown : held_) {
      gradient_[unknown] = 0.0;
      information.row(unknown).setZero();
      information.col(unknown).setZero();
      information(unknown, unknown) = 1.0;
    }
    information.diagonal() *= 1.0 + damping_;
    factor_.emplace(information);
  }

  // Nonlinear parameters that stand at a bound and would leave it.
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
  std::optional<ScaledCholesky> factor_;  // none: the next step needs a new one
  std::vector<int> held_;                 // by bounds, in the factor
  double promised_ = 0.0;                 // by the step before
  double damping_ = 0.0;
};

}  // namespace

SolveSummary solve(Design& design, double smoothness_sigma, Accuracy accuracy) {
  if (design.unknowns() == 0) return {0, true, 0.0, "nothing to solve for"};
  const std::vector<PenaltyRow> penalties = penalty_rows(design, smoothness_sigma);
  return Descent(design, penalties).run(accuracy == Accuracy::kFull ? kSettled : kSettledOnTheWay);
}

}  // namespace armtrue
