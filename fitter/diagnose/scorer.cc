#include "fitter/diagnose/scorer.h"

#include <algorithm>
#include <cmath>
#include <map>

#include "fitter/common/dense.h"
#include "fitter/common/parallel.h"

namespace armtrue {
namespace {

// Directions of a block of which less than this share survives the projection are the fit's own, to
// rounding.
constexpr double kSmallestShare = 1e-7;
// A column so much smaller than another of its block is rounding: of a link that hangs plumb, or of
// a lever that is none.
constexpr double kMovesNothing = 1e-9;
// Coefficients outside their physical bound, or of the wrong sign by this many standard deviations,
// are refused.
constexpr double kWrongSign = 3.0;
// A rejected row counts as a residual of this many standard deviations.
constexpr double kBoundedResidual = 6.0;
// Blocks whose plain F test does not reach this are not worth the robust one.
constexpr double kWorthRobust = -3.0;
constexpr int kMostProjected = 400;

struct Linearised {
  Eigen::MatrixXd jacobian, geometry;
  Eigen::VectorXd residual;
  std::vector<std::size_t> rows;
  std::vector<int> column_of;  // of every unknown; −1 where it is not projected out
};

Linearised linearise(Fit& fit) {
  Design& design = fit.design();
  Linearised result;
  // Rows kept out of the fit take part with a bounded say: what looks like a bump may be a local
  // effect that no term names yet.
  const std::vector<double> weights = design.weights();
  Design::Row probe;
  for (std::size_t i = 0; i < design.rows(); ++i) {
    result.rows.push_back(i);
    if (weights[i] > 0.0) continue;
    design.weights()[i] = 1.0;
    design.evaluate(i, false, probe);
    const double size = probe.residual.head(design.residuals_per_row()).norm();
    design.weights()[i] = std::pow(kBoundedResidual / std::max(size, kBoundedResidual), 2);
  }
  const int height = design.residuals_per_row();
  const auto equations = static_cast<Eigen::Index>(result.rows.size()) * height;
  // The nodes of large tables are not projected out: the residual is orthogonal to them already,
  // and leaving them out only makes a candidate look weaker than it is, never stronger.
  const bool all = design.unknowns() <= kMostProjected;
  result.column_of.assign(static_cast<std::size_t>(design.unknowns()), -1);
  int width = 0;
  for (int u = 0; u < design.unknowns(); ++u) {
    if (all || !design.is_table_unknown(u)) result.column_of[static_cast<std::size_t>(u)] = width++;
  }
  result.jacobian = Eigen::MatrixXd::Zero(equations, width);
  result.geometry.resize(equations, fit.kinematics().layout().size());
  result.residual.resize(equations);
  design.each_row(true, [&](std::size_t i, const Design::Row& row, const auto& workspace) {
    const Eigen::Index at = static_cast<Eigen::Index>(i) * height;
    result.residual.segment(at, height) = row.residual.head(height);
    for (std::size_t u = 0; u < row.unknowns.size(); ++u) {
      const int column = result.column_of[static_cast<std::size_t>(row.unknowns[u])];
      if (column >= 0)
        result.jacobian.col(column).segment(at, height) =
            row.jacobian.col(static_cast<Eigen::Index>(u)).head(height);
    }
    const auto& geometric = workspace.geometric;
    for (Eigen::Index c = 0; c < geometric.cols(); ++c) {
      result.geometry.col(c).segment(at, height) = design.whiten(i, geometric.col(c)).head(height);
    }
  });
  design.weights() = weights;
  return result;
}

Eigen::MatrixXd information_of(const Linearised& l, const Fit& fit, const Design& design) {
  NormalEquations equations(l.jacobian.cols());
  equations.information = square(l.jacobian);
  std::vector<double> values(static_cast<std::size_t>(l.jacobian.cols()));
  const std::vector<double> all = design.unknown_values();
  for (std::size_t u = 0; u < all.size(); ++u) {
    if (l.column_of[u] >= 0) values[static_cast<std::size_t>(l.column_of[u])] = all[u];
  }
  for (PenaltyRow row : penalty_rows(design, fit.smoothness_sigma())) {
    for (auto& [unknown, factor] : row.entries)
      unknown = l.column_of[static_cast<std::size_t>(unknown)];
    const bool projected = std::all_of(row.entries.begin(), row.entries.end(),
                                       [](const auto& entry) { return entry.first >= 0; });
    if (projected) equations.add(row, values);
  }
  return equations.information;
}

const std::vector<double>& basis_values(const Term& term, const State& state,
                                        std::map<std::string, std::vector<double>>& cache) {
  const std::string key = term.basis.to_string();
  auto found = cache.find(key);
  if (found == cache.end()) {
    auto values = term.basis.evaluate(
        state.rows(),
        [&](const std::string& name) -> const std::vector<double>& { return state.column(name); });
    found = cache.emplace(key, std::move(values)).first;
  }
  return found->second;
}

}  // namespace

Scorer::Scorer(Fit& fit)
    : fit_(fit),
      layout_(fit.kinematics().layout()),
      height_(fit.design().residuals_per_row()),
      replicates_(fit.measurements(), {}),
      factor_(Eigen::MatrixXd::Identity(1, 1)) {
  Linearised l = linearise(fit);
  replicates_ = Replicates(fit.measurements(), l.rows);
  correlation_ = replicates_.correlation(l.residual, height_);
  white_ = l.residual;
  replicates_.whiten(white_, height_, correlation_);
  replicates_.whiten(l.jacobian, height_, correlation_);
  factor_ = ScaledCholesky(information_of(l, fit, fit.design()));
  rows_ = std::move(l.rows);
  residual_ = std::move(l.residual);
  jacobian_ = std::move(l.jacobian);
  geometry_ = std::move(l.geometry);
  correction_ = factor_.solve(jacobian_.transpose() * white_);
  freedom_ = std::max(1.0, static_cast<double>(residual_.size()) - fit.effective_unknowns());
}

Eigen::MatrixXd Scorer::columns(std::span<const Block> blocks) const {
  BasisCache cache;
  return columns(blocks, cache);
}

Eigen::MatrixXd Scorer::columns(std::span<const Block> blocks, BasisCache& cache) const {
  Eigen::Index width = 0;
  for (const Block& block : blocks)
    width += static_cast<Eigen::Index>(block.terms.parameters.size());
  Eigen::MatrixXd result = Eigen::MatrixXd::Zero(residual_.size(), width);
  Eigen::Index at = 0;
  for (const Block& block : blocks) {
    for (const Parameter& p : block.terms.parameters) {
      for (const Term& term : p.terms) {
        const std::vector<double>& basis = basis_values(term, fit_.state(), cache);
        const double* coordinate = geometry_.col(layout_.index(term.coordinate)).data();
        double* column = result.col(at).data();
        for (const std::size_t row : rows_) {
          const double value = term.weight * basis[row];
          for (int h = 0; h < height_; ++h) *column++ += value * *coordinate++;
        }
      }
      ++at;
    }
  }
  return result;
}

std::vector<BlockScore> Scorer::score(const std::vector<Block>& blocks, bool robust) const {
  // Blocks go through in batches, so that one matrix product serves many and memory stays small.
  constexpr Eigen::Index kBatchColumns = 256;
  const auto width_of = [&](std::size_t b) {
    return static_cast<Eigen::Index>(blocks[b].terms.parameters.size());
  };
  std::vector<std::size_t> batches{0};  // first block of each, and the end
  Eigen::Index columns = 0;
  for (std::size_t b = 0; b < blocks.size(); ++b) {
    if (b > batches.back() && columns + width_of(b) > kBatchColumns) {
      batches.push_back(b);
      columns = 0;
    }
    columns += width_of(b);
  }
  batches.push_back(blocks.size());
  std::vector<BlockScore> scores(blocks.size());
  in_parallel(batches.size() - 1, [&](std::size_t batch) {
    const std::size_t first = batches[batch], last = batches[batch + 1];
    BasisCache cache;
    Eigen::MatrixXd own = this->columns(std::span(blocks).subspan(first, last - first), cache);
    replicates_.whiten(own, height_, correlation_);
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
  const Eigen::MatrixXd half = factor_.half_solve(cross) * scale.asDiagonal();
  Eigen::MatrixXd information = scale.asDiagonal() * square(columns) * scale.asDiagonal();
  information -= square(half);
  const Eigen::VectorXd gradient =
      scale.asDiagonal() * (columns.transpose() * white_ - cross.transpose() * correction_);

  const double n = static_cast<double>(white_.size());
  const double variance = white_.squaredNorm() / freedom_;
  const SymmetricEigen eigen = symmetric_eigen(information);
  Eigen::VectorXd solution = Eigen::VectorXd::Zero(width);
  Eigen::MatrixXd inverse = Eigen::MatrixXd::Zero(width, width);
  std::vector<Eigen::Index> used;
  double gain = 0.0;
  for (Eigen::Index k = 0; k < width; ++k) {
    const double share = eigen.values[k];
    if (share < kSmallestShare) continue;
    const Eigen::VectorXd direction = eigen.vectors.col(k);
    // A direction whose coefficient the weak prior knows better than the data do is not the data's
    // to give.
    double prior = 0.0;
    for (Eigen::Index c = 0; c < width; ++c) {
      const double sigma = block.terms.parameters[static_cast<std::size_t>(c)].prior_sigma;
      if (sigma > 0.0 && scale[c] > 0.0) prior += std::pow(direction[c] / (sigma * norm[c]), 2);
    }
    if (share < prior * variance) continue;
    const double projection = direction.dot(gradient);
    gain += projection * projection / share;
    solution -= direction * (projection / share);
    inverse += direction * direction.transpose() / share;
    used.push_back(k);
  }
  score.degrees = static_cast<int>(used.size()) + block.searched;
  score.coefficient.resize(static_cast<std::size_t>(width));
  score.sigma.resize(static_cast<std::size_t>(width));
  double least = 1.0;
  for (Eigen::Index c = 0; c < width; ++c) {
    const auto i = static_cast<std::size_t>(c);
    score.coefficient[i] = solution[c] * scale[c];
    score.sigma[i] = std::sqrt(std::max(0.0, inverse(c, c))) * scale[c];
    if (scale[c] > 0.0) least = std::min(least, information(c, c));
  }
  score.separability = least;
  if (used.empty()) {
    score.objection = "the data cannot tell it from what is fitted already";
    return score;
  }
  const double rss = white_.squaredNorm();
  gain = std::min(gain, rss * (1.0 - 1e-12));
  const double freedom = std::max(1.0, freedom_ - score.degrees);
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
  Eigen::MatrixXd sums(rank, static_cast<Eigen::Index>(rows_.size()));  // a column a pose
  Eigen::Index poses = 0;
  std::map<int, Eigen::Index> place;
  for (std::size_t r = 0; r < rows_.size(); ++r) {
    const Eigen::Index at = static_cast<Eigen::Index>(r) * height_;
    const Eigen::VectorXd pose =
        along.middleRows(at, height_).transpose() * left.segment(at, height_);
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
      std::max(1.0, count - static_cast<double>(jacobian_.cols() + degrees) / height_);
  const Eigen::MatrixXd scatter = count / freedom * square_across(sums.leftCols(poses));
  Eigen::VectorXd share(rank);
  for (Eigen::Index k = 0; k < rank; ++k)
    share[k] = eigen.values[used[static_cast<std::size_t>(k)]];
  const Eigen::VectorXd gradient = share.cwiseProduct(coefficient);
  const double wald = gradient.dot(ScaledCholesky(scatter).solve(gradient));
  return log10_f_survival(wald / degrees, degrees, freedom);
}

}  // namespace armtrue
