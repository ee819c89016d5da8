#include "fitter/diagnose/scoring/scorer.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <span>

#include "fitter/common/dense.h"
#include "fitter/common/parallel.h"
#include "fitter/evidence/blocks.h"

namespace armtrue {
namespace {

// Directions of a block of which less than this share survives the projection are combinations of
// fitted columns, up to rounding.
constexpr double kSmallestShare = 1e-7;
// Directions of a block of which hardly more than this share survives are poorly determined: they
// are left out of BlockScore::beyond.
constexpr double kHardlyTold = 0.02;
// A column smaller than another of its block by this factor is rounding: of a link that hangs
// plumb, or of a lever of length zero.
constexpr double kMovesNothing = 1e-9;
// Coefficients that exceed their physical bound, or have the wrong sign, by this many standard
// deviations are refused.
constexpr double kWrongSign = 3.0;
// Blocks whose plain F test does not reach this log10 p skip the expensive robust test.
constexpr double kWorthRobust = -3.0;

// The nodes of large tables are not projected out: the residual is orthogonal to them already, and
// leaving them out only makes a candidate look weaker than it is, never stronger.
Eigen::MatrixXd projected_columns(const Linearization& l) {
  Eigen::MatrixXd columns(l.equations(), l.jacobian.cols() + l.nodes.cols());
  columns << l.jacobian, l.nodes;
  return columns;
}

// JᵀJ of those columns, with the penalties (priors, smoothness) of their unknowns added.
Eigen::MatrixXd information_of(const Eigen::MatrixXd& columns, const Linearization& l,
                               const Fit& fit) {
  const Design& design = fit.design();
  const std::vector<double> all = design.unknown_values();
  std::vector<int> column_of(all.size(), -1);
  std::vector<double> values;
  for (const std::vector<int>* unknowns : {&l.unknown, &l.node}) {
    for (const int u : *unknowns) {
      column_of[static_cast<std::size_t>(u)] = static_cast<int>(values.size());
      values.push_back(all[static_cast<std::size_t>(u)]);
    }
  }
  NormalEquations equations(columns.cols());
  equations.information = square(columns);
  for (PenaltyRow row : penalty_rows(design, fit.smoothness_sigma())) {
    for (auto& [unknown, factor] : row.entries)
      unknown = column_of[static_cast<std::size_t>(unknown)];
    const bool projected = std::all_of(row.entries.begin(), row.entries.end(),
                                       [](const auto& entry) { return entry.first >= 0; });
    if (projected) equations.add(row, values);
  }
  return equations.information;
}

// Standard deviation of each parameter's weak prior, 0 where `scale` is 0; empty if a parameter has
// no prior.
Eigen::VectorXd prior_units(const Block& block, const Eigen::VectorXd& scale) {
  Eigen::VectorXd units = Eigen::VectorXd::Zero(scale.size());
  for (Eigen::Index c = 0; c < scale.size(); ++c) {
    if (scale[c] == 0.0) continue;
    units[c] = block.terms.parameters[static_cast<std::size_t>(c)].prior_sigma;
    if (units[c] <= 0.0) return {};
  }
  return units;
}

// Coefficients that explain `gradient` with the least use of what the fitted columns can reproduce.
// `beyond`, `own`: Gram matrices of the scaled columns after and before the projection.
Eigen::VectorXd coefficients_beyond(const Eigen::MatrixXd& beyond, const Eigen::MatrixXd& own,
                                    const Eigen::VectorXd& gradient) {
  Eigen::MatrixXd ridge = beyond + kHardlyTold * own;
  for (Eigen::Index c = 0; c < ridge.cols(); ++c) {
    if (ridge(c, c) <= 0.0) ridge(c, c) = 1.0;  // a column that moves nothing
  }
  return -ScaledCholesky(ridge).solve(gradient);
}

}  // namespace

Scorer::Scorer(const Fit& fit, const Linearization& linearization)
    : fit_(fit),
      l_(linearization),
      replicates_(fit.measurements()),
      correlation_(replicates_.correlation(l_.residual, l_.height)),
      white_(l_.residual),
      jacobian_(projected_columns(l_)),
      factor_(Eigen::MatrixXd::Identity(1, 1)) {
  replicates_.whiten(white_, l_.height, correlation_);
  replicates_.whiten(jacobian_, l_.height, correlation_);
  factor_ = ScaledCholesky(information_of(jacobian_, l_, fit));
  correction_ = factor_.solve(jacobian_.transpose() * white_);
}

std::vector<BlockScore> Scorer::score(const std::vector<Block>& blocks, bool robust) const {
  // One matrix product serves a batch of blocks. A batch has about kBatchNumbers numbers, so that
  // many rows do not take much memory.
  constexpr Eigen::Index kMostColumns = 256, kFewestColumns = 48, kBatchNumbers = 1 << 20;
  const Eigen::Index columns_of_batch =
      std::clamp(kBatchNumbers / l_.equations(), kFewestColumns, kMostColumns);
  const auto width_of = [&](std::size_t b) {
    return static_cast<Eigen::Index>(blocks[b].terms.parameters.size());
  };
  std::vector<std::size_t> batches{0};  // first block of each, and the end
  Eigen::Index columns = 0;
  for (std::size_t b = 0; b < blocks.size(); ++b) {
    if (b > batches.back() && columns + width_of(b) > columns_of_batch) {
      batches.push_back(b);
      columns = 0;
    }
    columns += width_of(b);
  }
  batches.push_back(blocks.size());
  std::vector<BlockScore> scores(blocks.size());
  in_parallel(batches.size() - 1, [&](std::size_t batch) {
    const std::size_t first = batches[batch], last = batches[batch + 1];
    Eigen::MatrixXd own =
        block_columns(l_, fit_.state(), std::span(blocks).subspan(first, last - first));
    replicates_.whiten(own, l_.height, correlation_);
    const Eigen::MatrixXd cross = transpose_times(jacobian_, own);
    Eigen::Index at = 0;
    for (std::size_t b = first; b < last; ++b) {
      scores[b] = judge(blocks[b], own.middleCols(at, width_of(b)),
                        cross.middleCols(at, width_of(b)), robust);
      at += width_of(b);
    }
  });
  return scores;
}

BlockScore Scorer::judge(const Block& block, const Eigen::MatrixXd& columns,
                         const Eigen::MatrixXd& cross, bool robust) const {
  BlockScore score;
  const Eigen::Index width = columns.cols();
  const Eigen::VectorXd norm = columns.colwise().norm();
  Eigen::VectorXd scale(width);
  for (Eigen::Index c = 0; c < width; ++c)
    scale[c] = norm[c] > kMovesNothing * norm.maxCoeff() ? 1.0 / norm[c] : 0.0;
  const Eigen::MatrixXd half = factor_.half_solve(cross);
  const Eigen::MatrixXd own = square(columns);
  const Eigen::MatrixXd beyond = own - square(half);
  const Eigen::VectorXd gradient_by_unit =
      columns.transpose() * white_ - cross.transpose() * correction_;
  Eigen::MatrixXd information = scale.asDiagonal() * beyond * scale.asDiagonal();
  SymmetricEigen eigen = symmetric_eigen(information);
  score.spanned = eigen.values.maxCoeff() < kSmallestShare;
  score.separability = 1.0;
  for (Eigen::Index c = 0; c < width; ++c) {
    if (scale[c] > 0.0) score.separability = std::min(score.separability, information(c, c));
  }

  const Eigen::VectorXd told = scale.cwiseProduct(
      coefficients_beyond(information, scale.asDiagonal() * own * scale.asDiagonal(),
                          scale.cwiseProduct(gradient_by_unit)));
  score.beyond.assign(told.begin(), told.end());

  const double n = static_cast<double>(white_.size());
  const double variance = white_.squaredNorm() / l_.freedom;
  double least_share = kSmallestShare;
  // A direction that a weak prior determines better than the data do is left out. In units of the
  // priors, such directions separate from those that the data determine.
  if (const Eigen::VectorXd prior = prior_units(block, scale); prior.size() > 0) {
    scale = prior;
    information = scale.asDiagonal() * beyond * scale.asDiagonal();
    eigen = symmetric_eigen(information);
    least_share = variance;
  }
  const Eigen::VectorXd gradient = scale.cwiseProduct(gradient_by_unit);
  Eigen::VectorXd solution = Eigen::VectorXd::Zero(width);
  Eigen::MatrixXd inverse = Eigen::MatrixXd::Zero(width, width);
  std::vector<Eigen::Index> used;
  double gain = 0.0;
  for (Eigen::Index k = 0; k < width; ++k) {
    const double share = eigen.values[k];
    if (share < least_share) continue;
    const Eigen::VectorXd direction = eigen.vectors.col(k);
    const double projection = direction.dot(gradient);
    gain += projection * projection / share;
    solution -= direction * (projection / share);
    inverse += direction * direction.transpose() / share;
    used.push_back(k);
  }
  score.degrees = static_cast<int>(used.size()) + block.searched;
  score.coefficient.resize(static_cast<std::size_t>(width));
  score.sigma.resize(static_cast<std::size_t>(width));
  for (Eigen::Index c = 0; c < width; ++c) {
    const auto i = static_cast<std::size_t>(c);
    score.coefficient[i] = solution[c] * scale[c];
    score.sigma[i] = std::sqrt(std::max(0.0, inverse(c, c))) * scale[c];
  }
  if (used.empty()) {
    score.objection = "the data cannot tell it from what is fitted already";
    return score;
  }
  const double rss = white_.squaredNorm();
  gain = std::min(gain, rss * (1.0 - 1e-12));
  const double freedom = std::max(1.0, l_.freedom - score.degrees);
  const double after = rss - gain;
  for (double& s : score.sigma) s *= std::sqrt(after / freedom);
  score.gain = gain / variance;
  score.explained = gain / rss;
  score.log10_p =
      log10_f_survival((gain / score.degrees) / (after / freedom), score.degrees, freedom);
  if (robust && score.log10_p < kWorthRobust) {
    score.log10_p = std::max(
        score.log10_p, robust_log10_p(columns, cross, scale, eigen, used, solution, score.degrees));
  }
  score.delta_bic = n * std::log(after / rss) + score.degrees * std::log(n);
  for (std::size_t c = 0; c < block.terms.parameters.size(); ++c) {
    const Parameter& p = block.terms.parameters[c];
    const double value = score.coefficient[c];
    const double sigma = score.sigma[c];
    if (p.sign != 0 && p.sign_doubt == 0.0 && p.sign * value < -kWrongSign * sigma) {
      score.objection =
          describe(p) + " would have the wrong sign: a spring yields, it does not push back";
    } else if (p.bound > 0.0 && std::abs(value) - kWrongSign * sigma > p.bound) {
      score.objection = describe(p) + " would be larger than is physical";
    }
  }
  return score;
}

double Scorer::robust_log10_p(const Eigen::MatrixXd& columns, const Eigen::MatrixXd& cross,
                              const Eigen::VectorXd& scale, const SymmetricEigen& eigen,
                              const std::vector<Eigen::Index>& used,
                              const Eigen::VectorXd& solution, int degrees) const {
  const auto rank = static_cast<Eigen::Index>(used.size());
  Eigen::MatrixXd directions(columns.cols(), rank);
  for (Eigen::Index k = 0; k < rank; ++k)
    directions.col(k) = eigen.vectors.col(used[static_cast<std::size_t>(k)]);
  const Eigen::MatrixXd turned = scale.asDiagonal() * directions;
  const Eigen::MatrixXd along =
      times(columns, turned) - times(jacobian_, factor_.solve_matrix(times(cross, turned)));
  const Eigen::VectorXd coefficient = directions.transpose() * solution;
  const Eigen::VectorXd left = white_ + along * coefficient;
  Eigen::MatrixXd sums(rank, static_cast<Eigen::Index>(l_.rows()));  // one column per pose
  Eigen::Index poses = 0;
  std::map<int, Eigen::Index> place;
  for (std::size_t r = 0; r < l_.rows(); ++r) {
    const Eigen::Index at = static_cast<Eigen::Index>(r) * l_.height;
    const Eigen::VectorXd pose =
        along.middleRows(at, l_.height).transpose() * left.segment(at, l_.height);
    const int group = replicates_.group_of()[r];
    if (const auto known = place.find(group); group >= 0 && known != place.end()) {
      sums.col(known->second) += pose;
      continue;
    }
    if (group >= 0) place.emplace(group, poses);
    sums.col(poses++) = pose;
  }
  const auto count = static_cast<double>(poses);
  const double freedom =
      std::max(1.0, count - static_cast<double>(jacobian_.cols() + degrees) / l_.height);
  const Eigen::MatrixXd scatter = count / freedom * square_across(sums.leftCols(poses));
  Eigen::VectorXd share(rank);
  for (Eigen::Index k = 0; k < rank; ++k)
    share[k] = eigen.values[used[static_cast<std::size_t>(k)]];
  const Eigen::VectorXd gradient = share.cwiseProduct(coefficient);
  const double wald = gradient.dot(ScaledCholesky(scatter).solve(gradient));
  return log10_f_survival(wald / degrees, degrees, freedom);
}

}  // namespace armtrue
