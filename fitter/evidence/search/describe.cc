#include <algorithm>
#include <cmath>

#include "fitter/common/dense.h"
#include "fitter/evidence/search/sampler.h"

namespace armtrue {
namespace {

// A block that explains less than this share of what another does is no alternative to it.
constexpr double kComparable = 0.8;
// A column whose square is below this share of the largest in its block is rounding error.
constexpr double kMovesNothing = 1e-18;

}  // namespace

void Sampler::describe_alone(SearchResult& result) const {
  result.start_squares = eliminated_.squares();
  std::vector<Eigen::MatrixXd> alone;
  for (std::size_t b = 0; b < state_.size(); ++b) {
    const Conditional c = conditional(b);
    const std::vector<double> there(c.log_weight.begin() + 1, c.log_weight.end());
    result.alone_log_bayes.push_back(log_sum(there) - c.log_weight.front() - block(b).log_odds);
    const auto best =
        static_cast<std::size_t>(std::max_element(there.begin(), there.end()) - there.begin());
    result.alone_shape.push_back(c.choices[best + 1].shape);
    const Elimination::Local local = without(b);
    const Eigen::MatrixXd w = factor(b, c.choices[best + 1]);
    const Eigen::MatrixXd inner =
        Eigen::MatrixXd::Identity(w.cols(), w.cols()) + congruent(local.gram, w);
    const Eigen::VectorXd along = w.transpose() * local.gradient;
    result.alone_gain.push_back(along.dot(Cholesky(inner).solve(along)));
    alone.push_back(w);
    double least = 1.0;
    const double nothing =
        kMovesNothing * problem_.whole.segment(block(b).first, block(b).width).maxCoeff();
    for (Eigen::Index c2 = 0; c2 < block(b).width; ++c2) {
      const double before = problem_.whole[block(b).first + c2];
      if (before > nothing) least = std::min(least, std::max(0.0, local.gram(c2, c2)) / before);
    }
    result.separability.push_back(least);
  }
  result.beyond = beyond_each_other(alone, result);
}

// Element (a, b): share of b's gain that remains beside a. It is computed if both are absent and
// have a Bayes factor above 1, and if b explains at least about as much as a or a is a structure;
// otherwise it is 1.
Eigen::MatrixXd Sampler::beyond_each_other(const std::vector<Eigen::MatrixXd>& alone,
                                           const SearchResult& result) const {
  const auto count = static_cast<Eigen::Index>(alone.size());
  Eigen::MatrixXd beyond = Eigen::MatrixXd::Ones(count, count);
  for (std::size_t a = 0; a < alone.size(); ++a) {
    if (state_[a].is_present() || result.alone_log_bayes[a] <= 0.0) continue;
    const SearchBlock& first = block(a);
    const Elimination::Local left = without(a);
    const Eigen::MatrixXd own = congruent(left.gram, alone[a]);
    const Cholesky root(Eigen::MatrixXd::Identity(own.rows(), own.cols()) + own);
    const Eigen::VectorXd along_own = root.half_solve(alone[a].transpose() * left.gradient);
    for (std::size_t b = 0; b < alone.size(); ++b) {
      if (a == b || state_[b].is_present() || result.alone_log_bayes[b] <= 0.0) continue;
      if (first.counts && result.alone_gain[b] < kComparable * result.alone_gain[a]) continue;
      const SearchBlock& other = block(b);
      const Elimination::Local right = without(b);
      const Eigen::MatrixXd across =
          eliminated_.across(first.first, first.width, other.first, other.width);
      const Eigen::MatrixXd cross =
          root.half_solve(times(transpose_times(alone[a], across), alone[b]));
      Eigen::MatrixXd inner = congruent(right.gram, alone[b]);
      inner.diagonal().array() += 1.0;
      inner -= square(cross);
      const Eigen::VectorXd along =
          alone[b].transpose() * right.gradient - cross.transpose() * along_own;
      beyond(static_cast<Eigen::Index>(a), static_cast<Eigen::Index>(b)) =
          along.dot(Cholesky(inner).solve(along)) / result.alone_gain[b];
    }
  }
  return beyond;
}

void Sampler::describe(SearchResult& result) {
  go_to(best_);
  const std::size_t count = state_.size();
  result.squares = eliminated_.squares();
  result.log_evidence = best_posterior_;
  result.coefficient.resize(count);
  result.sigma.resize(count);
  result.shape.assign(count, 0);
  result.gain.assign(count, 0.0);
  result.log_bayes.assign(count, 0.0);
  result.likeliest.assign(count, false);
  const double noise = std::max(result.squares, 1e-9) / std::max(1.0, problem_.freedom);
  for (std::size_t b = 0; b < count; ++b) {
    const Conditional c = conditional(b);
    std::vector<double> there(c.log_weight.begin() + 1, c.log_weight.end());
    result.log_bayes[b] = log_sum(there) - c.log_weight.front() - block(b).log_odds;
    Choice use = state_[b];
    if (use.is_present()) {
      result.likeliest[b] = true;
      result.factors.emplace_back(b, factor(b, use));
    } else {
      use = c.choices[static_cast<std::size_t>(std::max_element(there.begin(), there.end()) -
                                               there.begin()) +
                      1];
    }
    const Elimination::Local local = without(b);
    const Eigen::MatrixXd w = factor(b, use);
    const Cholesky inner(Eigen::MatrixXd::Identity(w.cols(), w.cols()) +
                         w.transpose() * local.gram * w);
    const Eigen::VectorXd along = w.transpose() * local.gradient;
    const Eigen::VectorXd mean = inner.solve(along);
    result.gain[b] = along.dot(mean);
    const PriorShape& shape = block(b).shapes[static_cast<std::size_t>(use.shape)];
    const Eigen::MatrixXd units = shape.scale[static_cast<std::size_t>(use.scale)] * shape.units;
    result.shape[b] = use.shape;
    result.coefficient[b] = units * mean;
    const Eigen::MatrixXd spread = inner.half_solve(units.transpose());
    result.sigma[b] = (noise * spread.colwise().squaredNorm()).cwiseSqrt().transpose();
  }
}

}  // namespace armtrue
