#include "fitter/inference/cross_validation.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <numeric>
#include <random>
#include <utility>

#include "fitter/common/parallel.h"

namespace armtrue {
namespace {

// An unknown counts as measured by one fold alone if the other rows hold at most this share of its
// information: so small a remainder may be rounding error.
constexpr double kUnseen = 1e-9;

// Unknowns that only rows of this fold measure, such as the position of a reflector that no other
// fold saw: without the fold they have no estimate, so rows that need them are not scored. Nodes of
// tables are excepted, since smoothness predicts them from their neighbours.
std::vector<bool> unseen_unknowns(const Design& design, const Eigen::VectorXd& data,
                                  const NormalEquations& own) {
  std::vector<bool> unseen(static_cast<std::size_t>(data.size()), false);
  for (Eigen::Index u = 0; u < data.size(); ++u) {
    // An unknown that no row measures (a tilt of gravity if nothing bends) changes no prediction.
    const bool alone = data[u] > 0.0 && data[u] - own.information(u, u) <= kUnseen * data[u];
    unseen[static_cast<std::size_t>(u)] = alone && !design.is_table_unknown(static_cast<int>(u));
  }
  return unseen;
}

// Lloyd's algorithm from evenly spread starts; enough to cut a workspace into regions.
std::vector<int> cluster(const Eigen::Matrix3Xd& points, int count) {
  Eigen::Matrix3Xd centres(3, count);
  for (int c = 0; c < count; ++c)
    centres.col(c) = points.col((2 * c + 1) * points.cols() / (2 * count));
  std::vector<int> label(static_cast<std::size_t>(points.cols()), 0);
  for (int pass = 0; pass < 20; ++pass) {
    Eigen::Matrix3Xd sum = Eigen::Matrix3Xd::Zero(3, count);
    Eigen::VectorXd members = Eigen::VectorXd::Zero(count);
    for (Eigen::Index i = 0; i < points.cols(); ++i) {
      Eigen::Index nearest = 0;
      (centres.colwise() - points.col(i)).colwise().squaredNorm().minCoeff(&nearest);
      label[static_cast<std::size_t>(i)] = static_cast<int>(nearest);
      sum.col(nearest) += points.col(i);
      members[nearest] += 1.0;
    }
    for (int c = 0; c < count; ++c) {
      if (members[c] > 0.0) centres.col(c) = sum.col(c) / members[c];
    }
  }
  return label;
}

}  // namespace

std::vector<int> make_folds(const Design& design, Folding folding, int folds, std::uint64_t seed) {
  const Measurements& m = design.measurements();
  const std::vector<std::vector<std::size_t>> groups = m.poses.rows_by_posture();
  std::vector<int> fold_of_group(groups.size());
  if (folding == Folding::kRegion) {
    Eigen::Matrix3Xd points(3, static_cast<Eigen::Index>(groups.size()));
    for (std::size_t g = 0; g < groups.size(); ++g) {
      points.col(static_cast<Eigen::Index>(g)) =
          m.position.col(static_cast<Eigen::Index>(groups[g].front()));
    }
    fold_of_group = cluster(points, folds);
  } else {
    std::vector<std::size_t> order(groups.size());
    std::iota(order.begin(), order.end(), std::size_t{0});
    if (folding == Folding::kTime && design.state().recorded("time")) {
      const std::vector<double>& time = design.state().column("time");
      std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) {
        return time[groups[a].front()] < time[groups[b].front()];
      });
    }
    if (folding == Folding::kRandom) {
      // Fisher–Yates written out: std::shuffle's result is not the same on every standard library.
      std::mt19937_64 generator(seed);
      for (std::size_t i = order.size(); i > 1; --i)
        std::swap(order[i - 1], order[generator() % i]);
    }
    for (std::size_t rank = 0; rank < order.size(); ++rank) {
      const std::size_t block = folding == Folding::kTime
                                    ? rank * static_cast<std::size_t>(folds) / order.size()
                                    : rank % static_cast<std::size_t>(folds);
      fold_of_group[order[rank]] = static_cast<int>(block);
    }
  }
  std::vector<int> fold_of_row(m.rows);
  for (std::size_t g = 0; g < groups.size(); ++g) {
    for (const std::size_t row : groups[g]) fold_of_row[row] = fold_of_group[g];
  }
  return fold_of_row;
}

std::vector<std::vector<double>> held_out_distances(const Design& design,
                                                    const EvaluatedRows& evaluated,
                                                    const std::vector<std::vector<int>>& foldings,
                                                    int folds, double smoothness_sigma) {
  NormalEquations total = accumulate(design, evaluated);
  const Eigen::VectorXd data = total.information.diagonal();
  const std::vector<double> values = design.unknown_values();
  for (const PenaltyRow& penalty : penalty_rows(design, smoothness_sigma))
    total.add(penalty, values);
  std::vector<Eigen::Matrix3d> metres;  // by row: from whitened positions to metres
  for (const std::size_t i : evaluated.index) {
    metres.push_back(
        (std::sqrt(design.weights()[i]) * design.measurements().whiten_position[i]).inverse());
  }
  std::vector<std::vector<double>> result(
      foldings.size(),
      std::vector<double>(design.rows(), std::numeric_limits<double>::quiet_NaN()));
  const auto each = static_cast<std::size_t>(folds);
  in_parallel(foldings.size() * each, [&](std::size_t job) {
    const std::vector<int>& fold_of_row = foldings[job / each];
    std::vector<std::size_t> rows;
    for (std::size_t r = 0; r < evaluated.rows.size(); ++r) {
      if (fold_of_row[evaluated.index[r]] == static_cast<int>(job % each)) rows.push_back(r);
    }
    NormalEquations own(design.unknowns());
    std::vector<const Design::Row*> left_out;
    for (const std::size_t r : rows) left_out.push_back(&evaluated.rows[r]);
    own.add(left_out, design.residuals_per_row());
    const std::vector<bool> unseen = unseen_unknowns(design, data, own);
    own.information = total.information - own.information;
    const ScaledCholesky factor(std::move(own.information));
    const Eigen::VectorXd step = -factor.solve(total.gradient - own.gradient);
    for (const std::size_t r : rows) {
      const Design::Row& row = evaluated.rows[r];
      if (std::any_of(row.unknowns.begin(), row.unknowns.end(),
                      [&](int u) { return unseen[static_cast<std::size_t>(u)]; }))
        continue;
      Eigen::Vector3d change = row.residual.head<3>();
      for (std::size_t u = 0; u < row.unknowns.size(); ++u)
        change += row.jacobian.block<3, 1>(0, static_cast<Eigen::Index>(u)) * step[row.unknowns[u]];
      result[job / each][evaluated.index[r]] = (metres[r] * change).norm();
    }
  });
  return result;
}

CrossValidation cross_validate(const Design& design, const EvaluatedRows& evaluated, int folds,
                               std::uint64_t seed, double smoothness_sigma) {
  std::vector<std::vector<int>> foldings;
  for (const Folding folding : {Folding::kRandom, Folding::kTime, Folding::kRegion})
    foldings.push_back(make_folds(design, folding, folds, seed));
  CrossValidation result;
  result.distances = held_out_distances(design, evaluated, foldings, folds, smoothness_sigma);
  result.errors.clear();
  for (const std::vector<double>& distances : result.distances)
    result.errors.push_back(summarise_finite(distances));
  return result;
}

std::vector<double> residual_distances(Design& design) {
  std::vector<double> distance(design.rows());
  for (std::size_t i = 0; i < design.rows(); ++i) {
    distance[i] = (design.predict(i).translation() -
                   design.measurements().position.col(static_cast<Eigen::Index>(i)))
                      .norm();
  }
  return distance;
}

ErrorSummary summarise_finite(const std::vector<double>& distances) {
  std::vector<double> finite;
  std::copy_if(distances.begin(), distances.end(), std::back_inserter(finite),
               [](double d) { return std::isfinite(d); });
  return summarise(finite);
}

}  // namespace armtrue
