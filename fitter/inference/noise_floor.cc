#include "fitter/inference/noise_floor.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <numeric>
#include <optional>
#include <utility>
#include <vector>

namespace armtrue {
namespace {

// Of a vector of three independent unit normals: mean length (chi with three degrees of freedom);
// median and 99.9 % quantile of its squared length.
constexpr double kMeanChi3 = 1.5957691;
constexpr double kMedianChiSquared3 = 2.3659739;
constexpr double kLargestChiSquared3 = 16.2662362;
constexpr std::size_t kLeastFreedom = 9;
constexpr double kAboveResidual = 1.25;  // chance in few repeats stays below this ratio

// Half the squared change of a pose's error from one visit to the next [m²]. The difference of
// errors excludes what the model explains (payload, temperature), and consecutive visits exclude
// slow drift.
std::vector<double> half_squares_between_visits(Design& design) {
  const Measurements& m = design.measurements();
  std::map<std::pair<int, int>, std::vector<std::size_t>> visits;
  for (std::size_t i = 0; i < m.rows; ++i) {
    if (design.weights()[i] > 0.0) visits[{m.poses.pose_of_row[i], m.target[i]}].push_back(i);
  }
  const bool timed = design.state().has("time");
  std::vector<double> half_squares;
  for (auto& [id, rows] : visits) {
    if (timed) {
      const std::vector<double>& time = design.state().column("time");
      std::stable_sort(rows.begin(), rows.end(),
                       [&](std::size_t a, std::size_t b) { return time[a] < time[b]; });
    }
    std::optional<Eigen::Vector3d> before;
    int last_visit = -1;
    for (const std::size_t i : rows) {
      // One reading of each visit: the others do not show how the arm repeats.
      if (std::exchange(last_visit, m.poses.visit_of_row[i]) == m.poses.visit_of_row[i]) continue;
      const Eigen::Vector3d error =
          design.predict(i).translation() - m.position.col(static_cast<Eigen::Index>(i));
      if (before) half_squares.push_back((error - *before).squaredNorm() / 2.0);
      before = error;
    }
  }
  return half_squares;
}

// `source` is empty if poses were not repeated often enough.
NoiseFloor floor_of_repeats(Design& design, const ErrorSummary& train, double effective_unknowns) {
  std::vector<double> half_squares = half_squares_between_visits(design);
  // Visits hours apart also differ by unmodelled effects. Most visits are consecutive, so the
  // median shows which differences are too large.
  const double largest =
      half_squares.empty() ? 0.0 : kLargestChiSquared3 * median(half_squares) / kMedianChiSquared3;
  std::erase_if(half_squares, [&](double v) { return v > largest; });
  const double squares = std::accumulate(half_squares.begin(), half_squares.end(), 0.0);
  const std::size_t freedom = 3 * half_squares.size();
  if (freedom < kLeastFreedom) return {0.0, "", freedom};
  // Positions rounded to the same value agree, although each has the rounding error.
  const double mean = kMeanChi3 * std::max(std::sqrt(squares / static_cast<double>(freedom)),
                                           design.measurements().rounding.sigma());
  // If all visits are far apart in time, their differences contain drift. The noise is never more
  // than the residual of the fit.
  const double n = static_cast<double>(train.count) * design.residuals_per_row();
  const double left = train.mean / std::sqrt(std::max(0.2, 1.0 - effective_unknowns / n));
  return {mean > kAboveResidual * left ? left : mean, "repeats", freedom};
}

// Distances [m] between each pair of reflectors, pose by pose while the arm stood still.
std::map<std::pair<int, int>, std::vector<double>> distances_between_targets(const Design& design) {
  const Measurements& m = design.measurements();
  const auto n = static_cast<std::size_t>(design.state().robot().joint_count());
  std::map<std::vector<double>, std::vector<std::size_t>> standing;
  for (std::size_t i = 0; i < m.rows; ++i) {
    if (design.weights()[i] == 0.0) continue;
    const double* q = &design.state().joints()[i * n];
    standing[{q, q + n}].push_back(i);
  }
  std::map<std::pair<int, int>, std::vector<double>> distances;
  for (const auto& [q, rows] : standing) {
    for (std::size_t a = 0; a < rows.size(); ++a) {
      for (std::size_t b = a + 1; b < rows.size(); ++b) {
        const auto pair = std::minmax(m.target[rows[a]], m.target[rows[b]]);
        if (pair.first == pair.second) continue;
        const auto at = [&](std::size_t i) { return m.position.col(static_cast<Eigen::Index>(i)); };
        distances[{pair.first, pair.second}].push_back((at(rows[a]) - at(rows[b])).norm());
      }
    }
  }
  return distances;
}

// Reflectors on one rigid tool, measured while the arm stood still: the distance between two is
// constant, and its measured values scatter by twice the instrument's variance. The arm's own
// repeatability is not included.
NoiseFloor floor_between_targets(const Design& design, std::size_t freedom_of_repeats) {
  double squares = 0.0;
  std::size_t freedom = 0;
  if (design.measurements().targets > 1) {
    for (const auto& [pair, lengths] : distances_between_targets(design)) {
      const double mean = std::accumulate(lengths.begin(), lengths.end(), 0.0) /
                          static_cast<double>(lengths.size());
      for (const double length : lengths) squares += (length - mean) * (length - mean) / 2.0;
      freedom += lengths.size() - 1;
    }
  }
  if (freedom < kLeastFreedom)
    return {std::numeric_limits<double>::quiet_NaN(), "none", freedom_of_repeats};
  return {kMeanChi3 * std::sqrt(squares / static_cast<double>(freedom)), "targets", freedom};
}

}  // namespace

NoiseFloor measure_noise_floor(Design& design, const ErrorSummary& train, double effective_unknowns,
                               double stated_sigma) {
  NoiseFloor repeats = floor_of_repeats(design, train, effective_unknowns);
  if (!repeats.source.empty()) return repeats;
  if (design.measurements().sigma_source != SigmaSource::kAssumed)
    return {kMeanChi3 * stated_sigma, "sigma", repeats.count};
  return floor_between_targets(design, repeats.count);
}

}  // namespace armtrue
