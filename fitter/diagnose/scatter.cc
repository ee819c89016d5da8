#include <algorithm>
#include <cmath>
#include <map>
#include <set>
#include <utility>

#include "fitter/diagnose/structure.h"
#include "fitter/inference/replicates.h"

namespace armtrue {
namespace {

constexpr std::size_t kNeighbourRows = 3000;
constexpr double kLeastScatterFreedom = 8.0;
constexpr double kScatterSurely = -6.0;

using PlacedVector = std::pair<Eigen::Index, Eigen::Vector3d>;  // row, and its residual

JointScatter along_joints(const Linearization& l, int joints,
                          const std::vector<PlacedVector>& vectors, double freedom,
                          bool between_repeats) {
  JointScatter result;
  result.between_repeats = between_repeats;
  if (freedom < kLeastScatterFreedom) return result;
  for (int joint = 1; joint <= joints; ++joint) {
    const auto column = l.geometry.col(l.layout.motor(joint - 1));
    double along = 0.0, all = 0.0;
    for (const auto& [r, vector] : vectors) {
      const Eigen::Vector3d direction = column.segment<3>(r * l.height);
      if (direction.squaredNorm() == 0.0) continue;
      along += std::pow(vector.dot(direction.normalized()), 2);
      all += vector.squaredNorm();
    }
    if (all <= 0.0 || along / all <= result.share) continue;
    result.joint = joint;
    result.share = along / all;
    const double across = std::max(all - along, 1e-12 * all);
    result.log10_p = std::min(0.0, log10_f_survival(2.0 * along / across, freedom, 2.0 * freedom) +
                                       std::log10(static_cast<double>(joints)));
  }
  return result;
}

}  // namespace

LackOfFit lack_of_fit(const Linearization& l, const Fit& fit, NoiseParts noise) {
  LackOfFit result;
  const int h = l.height;
  // Only a few poses were repeated, and a joint that repeats badly moves the tool further at some
  // poses than at others. So every residual is divided by the standard deviation that joints and
  // reading give at its own pose; then repeats and other poses can be compared.
  noise.pose.reset();  // an error shared by all readings of a pose is the lack of fit tested for
  Eigen::MatrixXd whitened = l.residual;
  PoseWhitening(l, noise).apply(whitened);
  const auto residual = [&](std::size_t r) {
    return whitened.col(0).segment(static_cast<Eigen::Index>(r) * h, h);
  };
  const Poses& poses = fit.measurements().poses;
  std::map<std::pair<int, int>, std::vector<std::size_t>> groups;
  std::set<std::pair<int, int>> seen;  // visit, reflector
  for (std::size_t row = 0; row < l.rows(); ++row) {
    // Readings of one visit do not show how the arm scatters from one visit to the next.
    if (!seen.insert({poses.visit_of_row[row], fit.measurements().target[row]}).second) continue;
    groups[{poses.pose_of_row[row], fit.measurements().target[row]}].push_back(row);
  }
  double pure = 0.0, freedom = 0.0;
  for (const auto& [id, rows] : groups) {
    if (rows.size() < 2) continue;
    Eigen::VectorXd mean = Eigen::VectorXd::Zero(h);
    for (const std::size_t r : rows) mean += residual(r) / static_cast<double>(rows.size());
    for (const std::size_t r : rows) pure += (residual(r) - mean).squaredNorm();
    freedom += h * (static_cast<double>(rows.size()) - 1.0);
  }
  if (freedom >= 9.0 && l.freedom > freedom + 10.0) {
    double all = 0.0;
    for (std::size_t r = 0; r < l.rows(); ++r) all += residual(r).squaredNorm();
    const double left = std::max(0.0, all - pure);
    const double left_freedom = l.freedom - freedom;
    result.testable = true;
    result.against = "repeats";
    result.log10_p =
        log10_f_survival((left / left_freedom) / (pure / freedom), left_freedom, freedom);
  } else if (fit.measurements().sigma_source != SigmaSource::kAssumed) {
    // The stated sigma is the instrument's: repeatability comes on top, so half as much again is
    // allowed for.
    const double scale2 = fit.noise_scale() * fit.noise_scale();
    result.testable = true;
    result.against = "sigma";
    result.log10_p =
        log10_chi2_survival(l.residual.squaredNorm() * scale2 / (1.5 * 1.5), l.freedom);
  }
  return result;
}

JointScatter scatter_along_joints(const Linearization& l, const Fit& fit) {
  const int h = l.height;
  const auto residual = [&](Eigen::Index r) -> Eigen::Vector3d {
    return l.residual.segment<3>(r * h);
  };
  std::vector<PlacedVector> left, between;
  for (Eigen::Index r = 0; r < static_cast<Eigen::Index>(l.rows()); ++r)
    left.emplace_back(r, residual(r));
  double freedom = 0.0;
  const Replicates replicates(fit.measurements());
  for (const std::vector<Eigen::Index>& rows : replicates.groups()) {
    Eigen::Vector3d mean = Eigen::Vector3d::Zero();
    for (const Eigen::Index r : rows) mean += residual(r) / static_cast<double>(rows.size());
    for (const Eigen::Index r : rows) between.emplace_back(r, residual(r) - mean);
    freedom += static_cast<double>(rows.size()) - 1.0;
  }
  const int joints = fit.robot().joint_count();
  const JointScatter of_repeats = along_joints(l, joints, between, freedom, true);
  const JointScatter of_residual = along_joints(l, joints, left, l.freedom / h, false);
  return of_repeats.log10_p <= kScatterSurely ? of_repeats : of_residual;
}

double neighbour_ratio(const Linearization& l, const State& state) {
  const std::size_t rows = std::min(l.rows(), kNeighbourRows);
  const auto n = static_cast<std::size_t>(state.robot().joint_count());
  const int h = l.height;
  if (rows < 10) return 1.0;
  double differences = 0.0, squares = 0.0;
  const auto joints = [&](std::size_t r) { return &state.joints()[r * n]; };
  for (std::size_t a = 0; a < rows; ++a) {
    double nearest = 1e300;
    std::size_t neighbour = a;
    for (std::size_t b = 0; b < rows; ++b) {
      if (a == b) continue;
      double distance = 0.0;
      for (std::size_t k = 0; k < n; ++k) distance += std::pow(joints(a)[k] - joints(b)[k], 2);
      if (distance < nearest) {
        nearest = distance;
        neighbour = b;
      }
    }
    const Eigen::VectorXd ra = l.residual.segment(static_cast<Eigen::Index>(a) * h, h);
    differences +=
        (ra - l.residual.segment(static_cast<Eigen::Index>(neighbour) * h, h)).squaredNorm();
    squares += ra.squaredNorm();
  }
  return squares > 0.0 ? differences / (2.0 * squares) : 1.0;
}

}  // namespace armtrue
