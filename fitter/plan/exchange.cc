#include "fitter/plan/exchange.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

#include "fitter/common/dense.h"
#include "fitter/common/observer.h"
#include "fitter/design/normal_equations.h"

namespace armtrue {
namespace {

constexpr int kMostPasses = 20;
// An exchange must gain more than rounding.
constexpr double kWorthwhile = 1e-9;
constexpr double kTieBreak = 1e-3;
// If a removal leaves less than this share of the information in any direction, the inverse is
// computed anew instead of updated.
constexpr double kWellKnown = 1e-4;
constexpr int kRefresh = 100;

// The least of several values, plus a small share of their mean.
template <typename ValueOf>
double least_and_mean(const std::vector<MeasurementChoice>& pairs, const ValueOf& value_of) {
  double least = std::numeric_limits<double>::infinity();
  double sum = 0.0;
  for (const MeasurementChoice& pair : pairs) {
    const double value = value_of(pair);
    least = std::min(least, value);
    sum += value;
  }
  return least + kTieBreak * sum / static_cast<double>(pairs.size());
}

// The free measurement that makes the criterion largest; at least one must be free.
std::size_t best_to_add(const Criterion& criterion, const std::vector<bool>& free) {
  const auto first = std::find(free.begin(), free.end(), true);
  auto best = static_cast<std::size_t>(first - free.begin());
  double most = -std::numeric_limits<double>::infinity();
  for (std::size_t i = best; i < criterion.count(); ++i) {
    if (!free[i]) continue;
    const double value = criterion.value_with(i);
    if (value > most) {
      most = value;
      best = i;
    }
  }
  return best;
}

}  // namespace

MeasurementChoice::MeasurementChoice(const Eigen::MatrixXd& jacobian, int height,
                                     const Eigen::MatrixXd& start)
    : jacobian_(&jacobian),
      height_(height),
      information_(start),
      start_log_determinant_(ScaledCholesky(start).log_determinant()),
      leverage_(static_cast<std::size_t>(jacobian.rows() / height)) {
  solve_anew();
}

MeasurementChoice::MeasurementChoice(const Eigen::MatrixXd& jacobian, int height,
                                     const Eigen::MatrixXd& start,
                                     const Eigen::VectorXd& difference,
                                     const Eigen::VectorXd& gradient, double squares)
    : MeasurementChoice(jacobian, height, start) {
  difference_ = difference;
  gradient_ = gradient;
  squares_ = squares;
  error_.resize(leverage_.size());
  solve_anew();
}

void MeasurementChoice::solve_anew() {
  const ScaledCholesky factor(information_);
  covariance_ = factor.inverse();
  log_determinant_ = factor.log_determinant() - start_log_determinant_;
  const Eigen::MatrixXd spread = times(*jacobian_, covariance_);
  for (std::size_t i = 0; i < leverage_.size(); ++i) {
    const Eigen::Index at = static_cast<Eigen::Index>(i) * height_;
    leverage_[i].noalias() = spread.middleRows(at, height_).lazyProduct(rows_of(i).transpose());
  }
  if (error_.empty()) return;
  const Eigen::VectorXd step = factor.solve(gradient_);
  left_ = std::max(0.0, squares_ - gradient_.dot(step));
  const Eigen::VectorXd error = difference_ - *jacobian_ * step;
  for (std::size_t i = 0; i < error_.size(); ++i) {
    error_[i] = error.segment(static_cast<Eigen::Index>(i) * height_, height_);
  }
}

Eigen::LLT<MeasurementChoice::Block> MeasurementChoice::grown(std::size_t i) const {
  return Eigen::LLT<Block>(Block::Identity(height_, height_) + leverage_[i]);
}

double MeasurementChoice::log_determinant_gain(std::size_t i) const {
  return 2.0 * grown(i).matrixLLT().diagonal().array().log().sum();
}

double MeasurementChoice::left_gain(std::size_t i) const {
  Part half = error_[i];
  grown(i).matrixL().solveInPlace(half);
  return half.squaredNorm();
}

void MeasurementChoice::change(std::size_t i, double sign) {
  throw_if_cancelled();
  const auto rows = rows_of(i);
  information_ += sign * square(rows);
  if (!error_.empty()) {
    const auto d = difference_.segment(static_cast<Eigen::Index>(i) * height_, height_);
    gradient_ += sign * (rows.transpose() * d);
    squares_ += sign * d.squaredNorm();
  }
  const SymmetricEigen eigen = symmetric_eigen(Eigen::MatrixXd::Identity(height_, height_) +
                                               sign * Eigen::MatrixXd(leverage_[i]));
  // Removing the only measurement that determines a direction divides by nearly zero, and rounding
  // errors accumulate over many updates.
  if (eigen.values[0] < kWellKnown || ++changes_ % kRefresh == 0) {
    solve_anew();
    return;
  }
  log_determinant_ += eigen.values.array().log().sum();
  // The inverse changes by −sign · response · responseᵀ.
  const Eigen::MatrixXd root = eigen.vectors * eigen.values.cwiseSqrt().cwiseInverse().asDiagonal();
  const Eigen::MatrixXd response = times(covariance_, rows.transpose() * root);
  const Eigen::MatrixXd cross = times(*jacobian_, response);
  Part step;
  if (!error_.empty()) {
    step = root.transpose() * error_[i];
    left_ += sign * step.squaredNorm();
  }
  for (std::size_t k = 0; k < leverage_.size(); ++k) {
    const Block part = cross.middleRows(static_cast<Eigen::Index>(k) * height_, height_);
    leverage_[k].noalias() -= sign * part.lazyProduct(part.transpose());
    if (!error_.empty()) error_[k].noalias() -= sign * part.lazyProduct(step);
  }
  covariance_ -= sign * square_across(response);
}

double Criterion::value() const {
  if (!rivals_) return choices_.front().log_determinant();
  return least_and_mean(choices_, [](const MeasurementChoice& pair) { return pair.left(); });
}

double Criterion::value_with(std::size_t i) const {
  if (!rivals_) return value() + choices_.front().log_determinant_gain(i);
  return least_and_mean(
      choices_, [&](const MeasurementChoice& pair) { return pair.left() + pair.left_gain(i); });
}

std::vector<std::size_t> choose_greedily(Criterion& criterion, std::size_t count,
                                         const std::vector<bool>& allowed,
                                         const std::function<void(double)>& step) {
  std::vector<std::size_t> chosen;
  std::vector<bool> free = allowed;
  const auto most = static_cast<std::size_t>(std::count(free.begin(), free.end(), true));
  const std::size_t wanted = std::min(count, most);
  while (chosen.size() < wanted) {
    chosen.push_back(best_to_add(criterion, free));
    free[chosen.back()] = false;
    criterion.add(chosen.back());
    if (step) step(static_cast<double>(chosen.size()) / static_cast<double>(wanted));
  }
  return chosen;
}

std::vector<std::size_t> choose_best(Criterion& criterion, std::size_t count,
                                     const std::vector<bool>& allowed,
                                     const std::function<void(double)>& step) {
  std::vector<std::size_t> chosen = choose_greedily(criterion, count, allowed, [&](double share) {
    if (step) step(0.5 * share);
  });
  std::vector<bool> free = allowed;
  for (const std::size_t i : chosen) free[i] = false;
  for (int pass = 0; pass < kMostPasses; ++pass) {
    bool changed = false;
    for (std::size_t& member : chosen) {
      const double before = criterion.value();
      criterion.remove(member);
      free[member] = true;
      const std::size_t better = best_to_add(criterion, free);
      const bool worth =
          criterion.value_with(better) > before + kWorthwhile * (1.0 + std::abs(before));
      if (worth) member = better;
      changed = changed || worth;
      free[member] = false;
      criterion.add(member);
    }
    if (step) step(0.5 + 0.5 * (pass + 1) / kMostPasses);
    if (!changed) break;
  }
  return chosen;
}

double uniform(std::mt19937_64& generator) {
  return static_cast<double>(generator() >> 11U) * 0x1.0p-53;
}

std::vector<std::size_t> choose_random(std::size_t size, std::size_t count,
                                       std::mt19937_64& generator) {
  std::vector<std::size_t> order(size);
  std::iota(order.begin(), order.end(), std::size_t{0});
  const std::size_t wanted = std::min(count, size);
  for (std::size_t k = 0; k < wanted; ++k) {
    std::swap(order[k], order[k + generator() % (size - k)]);
  }
  order.resize(wanted);
  return order;
}

}  // namespace armtrue
