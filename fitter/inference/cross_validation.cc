#include "fitter/inference/cross_validation.h"

#include <Eigen/LU>
#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>
#include <map>
#include <utility>

#include "fitter/common/parallel.h"

namespace armtrue {
namespace {

// An unknown counts as measured by one fold alone if the other rows hold at most this share of its
// information: so small a remainder may be rounding error.
constexpr double kUnseen = 1e-9;

// Random splits are averaged, because with few poses the error depends on which of them are in one
// fold. From kPosesOfOneSplit poses on, one split is enough.
constexpr std::size_t kPosesOfOneSplit = 800;
constexpr std::size_t kMostSplits = 6;

std::size_t random_splits(const Design& design) {
  const std::size_t poses = design.measurements().poses.rows_by_posture().size();
  return std::clamp<std::size_t>(kPosesOfOneSplit / poses, 1, kMostSplits);
}

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
std::vector<int> cluster(const Eigen::Matrix3Xd& points, const std::vector<std::size_t>& order,
                         int count) {
  const auto at = [&](std::size_t rank) {
    return points.col(static_cast<Eigen::Index>(order[rank]));
  };
  Eigen::Matrix3Xd centres(3, count);
  for (int c = 0; c < count; ++c) {
    centres.col(c) = at(static_cast<std::size_t>(2 * c + 1) * order.size() /
                        static_cast<std::size_t>(2 * count));
  }
  std::vector<int> label(order.size(), 0);
  for (int pass = 0; pass < 20; ++pass) {
    Eigen::Matrix3Xd sum = Eigen::Matrix3Xd::Zero(3, count);
    Eigen::VectorXd members = Eigen::VectorXd::Zero(count);
    for (std::size_t rank = 0; rank < order.size(); ++rank) {
      Eigen::Index nearest = 0;
      (centres.colwise() - at(rank)).colwise().squaredNorm().minCoeff(&nearest);
      label[order[rank]] = static_cast<int>(nearest);
      sum.col(nearest) += at(rank);
      members[nearest] += 1.0;
    }
    for (int c = 0; c < count; ++c) {
      if (members[c] > 0.0) centres.col(c) = sum.col(c) / members[c];
    }
  }
  return label;
}

// A number drawn from the joints of a row alone (splitmix64 of Steele et al. 2014, OOPSLA, 453).
std::uint64_t drawn_for(const State& state, std::size_t row, std::uint64_t seed) {
  const auto joints = static_cast<std::size_t>(state.robot().joint_count());
  std::uint64_t drawn = seed;
  for (std::size_t k = 0; k < joints; ++k) {
    drawn += 0x9e3779b97f4a7c15u + std::bit_cast<std::uint64_t>(state.joints()[row * joints + k]);
    drawn = (drawn ^ (drawn >> 30)) * 0xbf58476d1ce4e5b9u;
    drawn = (drawn ^ (drawn >> 27)) * 0x94d049bb133111ebu;
    drawn ^= drawn >> 31;
  }
  return drawn;
}

// Groups of rows in an order that depends on the poses and the seed, not on the order of rows.
std::vector<std::size_t> drawn_order(const State& state,
                                     const std::vector<std::vector<std::size_t>>& groups,
                                     std::uint64_t seed) {
  std::vector<std::pair<std::uint64_t, std::size_t>> drawn;
  for (std::size_t g = 0; g < groups.size(); ++g) {
    std::uint64_t least = std::numeric_limits<std::uint64_t>::max();
    for (const std::size_t row : groups[g]) least = std::min(least, drawn_for(state, row, seed));
    drawn.emplace_back(least, g);
  }
  std::ranges::sort(drawn);
  std::vector<std::size_t> order;
  for (const auto& [number, g] : drawn) order.push_back(g);
  return order;
}

}  // namespace

std::vector<int> make_folds(const Design& design, Folding folding, int folds, std::uint64_t seed) {
  const Measurements& m = design.measurements();
  const State& state = design.state();
  const std::vector<std::vector<std::size_t>> groups = m.poses.rows_by_posture();
  std::vector<std::size_t> order = drawn_order(state, groups, seed);
  std::vector<int> fold_of_group(groups.size());
  if (folding == Folding::kRegion) {
    Eigen::Matrix3Xd points(3, static_cast<Eigen::Index>(groups.size()));
    for (std::size_t g = 0; g < groups.size(); ++g) {
      std::vector<Eigen::Index> rows(groups[g].begin(), groups[g].end());
      points.col(static_cast<Eigen::Index>(g)) = m.position(Eigen::all, rows).rowwise().mean();
    }
    fold_of_group = cluster(points, order, folds);
  } else {
    if (folding == Folding::kTime) {
      // Without a time, rows stand in the order in which they were measured.
      const bool timed = state.recorded("time");
      std::vector<double> begin;
      for (const std::vector<std::size_t>& rows : groups) {
        begin.push_back(static_cast<double>(rows.front()));
        if (!timed) continue;
        const std::vector<double>& time = state.column("time");
        begin.back() = time[rows.front()];
        for (const std::size_t row : rows) begin.back() = std::min(begin.back(), time[row]);
      }
      std::ranges::stable_sort(order, {}, [&](std::size_t g) { return begin[g]; });
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
                                                    int folds, double smoothness_sigma,
                                                    const std::vector<Eigen::Index>& unforeseen) {
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
    Eigen::VectorXd step = -factor.solve(total.gradient - own.gradient);
    for (const Eigen::Index u : unforeseen) step[u] = -values[static_cast<std::size_t>(u)];
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
                               std::uint64_t seed, double smoothness_sigma,
                               const std::vector<Eigen::Index>& unforeseen) {
  std::vector<std::vector<int>> foldings{make_folds(design, Folding::kTime, folds, seed),
                                         make_folds(design, Folding::kRegion, folds, seed)};
  // The split of seed + 1 chooses options (choose_options.cc), so it must not judge them, too.
  const std::size_t splits = random_splits(design);
  for (std::size_t s = 0; s < splits; ++s)
    foldings.push_back(make_folds(design, Folding::kRandom, folds, seed + 2 * s));
  const std::vector<std::vector<double>> distances =
      held_out_distances(design, evaluated, foldings, folds, smoothness_sigma, unforeseen);
  std::vector<double> at_random(design.rows(), 0.0);
  for (std::size_t i = 0; i < at_random.size(); ++i) {
    for (std::size_t s = 0; s < splits; ++s)
      at_random[i] += distances[2 + s][i] / static_cast<double>(splits);
  }
  CrossValidation result;
  result.distances = {std::move(at_random), distances[0], distances[1]};
  result.errors.clear();
  for (const std::vector<double>& of_rows : result.distances)
    result.errors.push_back(summarise_finite(of_rows));
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
