#include "fitter/inference/replicates.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <map>
#include <numeric>

namespace armtrue {
namespace {

constexpr int kSteps = 50;
constexpr double kMostCorrelation = 0.98;

std::vector<std::size_t> all_rows(const Measurements& measurements) {
  std::vector<std::size_t> rows(measurements.rows);
  std::iota(rows.begin(), rows.end(), std::size_t{0});
  return rows;
}

}  // namespace

Replicates::Replicates(const Measurements& measurements)
    : Replicates(measurements, all_rows(measurements)) {}

Replicates::Replicates(const Measurements& measurements, const std::vector<std::size_t>& rows)
    : group_of_(rows.size(), -1) {
  if (!measurements.poses.any_repeated()) return;
  std::map<std::pair<int, int>, std::vector<Eigen::Index>> by_pose;
  for (std::size_t r = 0; r < rows.size(); ++r) {
    by_pose[{measurements.poses.pose_of_row[rows[r]], measurements.target[rows[r]]}].push_back(
        static_cast<Eigen::Index>(r));
  }
  for (auto& [pose, places] : by_pose) {
    if (places.size() < 2) continue;
    for (const Eigen::Index place : places)
      group_of_[static_cast<std::size_t>(place)] = static_cast<int>(groups_.size());
    groups_.push_back(std::move(places));
  }
}

double Replicates::log_determinant(double correlation) const {
  double sum = 0.0;
  for (const std::vector<Eigen::Index>& group : groups_) {
    const double m = static_cast<double>(group.size());
    sum += std::log1p((m - 1.0) * correlation) + (m - 1.0) * std::log1p(-correlation);
  }
  return sum;
}

std::vector<double> Replicates::worth(double correlation) const {
  std::vector<double> result(group_of_.size(), 1.0);
  for (const std::vector<Eigen::Index>& group : groups_) {
    const double design_effect = 1.0 + (static_cast<double>(group.size()) - 1.0) * correlation;
    for (const Eigen::Index place : group)
      result[static_cast<std::size_t>(place)] = 1.0 / design_effect;
  }
  return result;
}

double Replicates::correlation(const Eigen::VectorXd& residual, int height) const {
  if (!any()) return 0.0;
  // The likelihood depends only on the sums of squares by size of group.
  double single = residual.squaredNorm();
  std::map<std::size_t, std::array<double, 3>> sums;  // count, within, size × mean²
  for (const std::vector<Eigen::Index>& group : groups_) {
    Eigen::VectorXd mean = Eigen::VectorXd::Zero(height);
    double all = 0.0;
    for (const Eigen::Index place : group) {
      mean += residual.segment(place * height, height);
      all += residual.segment(place * height, height).squaredNorm();
    }
    const double between = mean.squaredNorm() / static_cast<double>(group.size());
    auto& [count, within, means] = sums[group.size()];
    count += 1.0;
    within += all - between;
    means += between;
    single -= all;
  }
  single = std::max(0.0, single);
  double likeliest = 0.0, least = std::numeric_limits<double>::infinity();
  for (int step = 0; step < kSteps; ++step) {
    const double rho = kMostCorrelation * step / (kSteps - 1);
    double squares = single, determinant = 0.0;
    for (const auto& [size, sum] : sums) {
      const double m = static_cast<double>(size);
      const double spread = 1.0 + (m - 1.0) * rho;
      squares += sum[1] / (1.0 - rho) + sum[2] / spread;
      determinant += sum[0] * height * (std::log(spread) + (m - 1.0) * std::log1p(-rho));
    }
    const double value = static_cast<double>(residual.size()) * std::log(squares) + determinant;
    if (value >= least) continue;
    least = value;
    likeliest = rho;
  }
  return likeliest;
}

void Replicates::whiten(Eigen::Ref<Eigen::MatrixXd> columns, int height, double correlation) const {
  if (correlation <= 0.0) return;
  Eigen::MatrixXd mean(height, columns.cols());
  for (const std::vector<Eigen::Index>& group : groups_) {
    const double m = static_cast<double>(group.size());
    const double part = 1.0 - std::sqrt((1.0 - correlation) / (1.0 + (m - 1.0) * correlation));
    mean.setZero();
    for (const Eigen::Index place : group) mean += columns.middleRows(place * height, height) / m;
    for (const Eigen::Index place : group) {
      auto rows = columns.middleRows(place * height, height);
      rows = (rows - part * mean) / std::sqrt(1.0 - correlation);
    }
  }
}

}  // namespace armtrue
