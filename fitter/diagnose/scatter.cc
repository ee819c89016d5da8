#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "fitter/diagnose/structure.h"
#include "fitter/evidence/words.h"
#include "fitter/inference/replicates.h"

namespace armtrue {
namespace {

constexpr std::size_t kNeighbourRows = 3000;
constexpr double kLeastScatterFreedom = 8.0;
constexpr double kScatterSurely = -6.0;
// A joint's scatter is reported if it moves the tool by at least this share of the readings'
// scatter: half of that increases the total by a ninth.
constexpr double kToldFromReading = 0.5;
// A joint counts as rounded if its scatter is within this factor of what rounding to the file's
// step makes.
constexpr double kAsRounded = 1.4;

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

namespace {

// Rows of one pose and reflector, the first of each visit: readings of one visit do not show how
// the arm scatters between visits.
std::vector<std::vector<std::size_t>> repeats_of(const Fit& fit, std::size_t rows) {
  const Poses& poses = fit.measurements().poses;
  std::map<std::pair<int, int>, std::vector<std::size_t>> groups;
  std::set<std::pair<int, int>> seen;  // visit, reflector
  for (std::size_t row = 0; row < rows; ++row) {
    const int target = fit.measurements().target[row];
    if (seen.insert({poses.visit_of_row[row], target}).second)
      groups[{poses.pose_of_row[row], target}].push_back(row);
  }
  std::vector<std::vector<std::size_t>> result;
  for (auto& [id, group] : groups) {
    if (group.size() > 1) result.push_back(std::move(group));
  }
  return result;
}

// log10 p of an F test of the variance between poses against that between repeats of one pose.
// `left`: one column per row, its residual or a component of it, which counts as `counted`
// equations; `freedom`: degrees of freedom of all rows; `rounding`: variance of a component by
// rounding, which repeats do not show. nullopt with too few repeats.
std::optional<double> log10_p_against(const std::vector<std::vector<std::size_t>>& repeats,
                                      const Eigen::MatrixXd& left, double counted, double freedom,
                                      double rounding) {
  double pure = 0.0, pure_freedom = 0.0;
  for (const std::vector<std::size_t>& rows : repeats) {
    Eigen::VectorXd mean = Eigen::VectorXd::Zero(left.rows());
    for (const std::size_t r : rows) mean += left.col(static_cast<Eigen::Index>(r));
    mean /= static_cast<double>(rows.size());
    for (const std::size_t r : rows)
      pure += (left.col(static_cast<Eigen::Index>(r)) - mean).squaredNorm();
    pure_freedom += counted * (static_cast<double>(rows.size()) - 1.0);
  }
  if (pure_freedom < kLeastScatterFreedom || freedom < pure_freedom + 10.0) return std::nullopt;
  const double between = std::max(0.0, left.squaredNorm() - pure), rest = freedom - pure_freedom;
  const double of_repeats = std::max(pure / pure_freedom, rounding);
  return log10_f_survival((between / rest) / of_repeats, rest, pure_freedom);
}

}  // namespace

DecimalStep rounding_of_joints(const NoiseParts& noise, const Fit& fit) {
  DecimalStep coarsest;
  const std::vector<double>& q = fit.state().joints();
  const auto n = static_cast<std::size_t>(fit.robot().joint_count());
  for (std::size_t k = 0; k < n; ++k) {
    std::vector<double> own;
    for (std::size_t i = k; i < q.size(); i += n) own.push_back(q[i]);
    const DecimalStep step =
        fit.robot().joints[k].prismatic ? step_of_lengths(own) : step_of_angles(own);
    if (step.size > coarsest.size && noise.joint[k] < kAsRounded * step.sigma() &&
        noise.joint[k] > step.sigma() / kAsRounded)
      coarsest = step;
  }
  return coarsest;
}

LackOfFit lack_of_fit(const Linearization& l, const Fit& fit, NoiseParts noise) {
  LackOfFit result;
  const Eigen::Index h = l.height, rows = static_cast<Eigen::Index>(l.rows());
  // Only a few poses were repeated, and a joint that repeats badly moves the tool further at some
  // poses than at others. Each residual is therefore divided by the standard deviation of joints
  // and reading at its own pose, so that repeats and other poses can be compared.
  noise.pose.reset();  // an error common to all readings of a pose is the lack of fit under test
  std::vector<int> scattering;
  for (std::size_t k = 0; k < noise.joint.size(); ++k) {
    if (noise.joint[k] > 0.0) scattering.push_back(static_cast<int>(k));
  }
  Eigen::MatrixXd whitened(l.residual.size(), static_cast<Eigen::Index>(scattering.size()) + 1);
  whitened.col(0) = l.residual;
  for (std::size_t i = 0; i < scattering.size(); ++i)
    whitened.col(static_cast<Eigen::Index>(i) + 1) = l.geometry.col(l.layout.motor(scattering[i]));
  PoseWhitening(l, noise).apply(whitened);
  const Eigen::Map<const Eigen::MatrixXd> left(whitened.data(), h, rows);
  const std::vector<std::vector<std::size_t>> repeats = repeats_of(fit, l.rows());
  const double per_row = l.counted / static_cast<double>(rows);
  const double rounding =
      std::pow(fit.measurements().rounding.sigma() / (noise.reading * l.typical_sigma), 2);
  if (const std::optional<double> of_all =
          log10_p_against(repeats, left, per_row, l.freedom, rounding)) {
    result.testable = true;
    result.against = "repeats";
    result.log10_p = *of_all;
    // Differences between poses along one joint's motion were attributed to that joint's
    // repeatability: its repeats must then differ as much in this one direction.
    for (Eigen::Index i = 1; i < whitened.cols(); ++i) {
      const Eigen::Map<const Eigen::MatrixXd> motion(whitened.col(i).data(), h, rows);
      const Eigen::RowVectorXd along = left.cwiseProduct(motion).colwise().sum().cwiseQuotient(
          motion.colwise().norm().cwiseMax(1e-300));
      const std::optional<double> of_joint =
          log10_p_against(repeats, along, 1.0, l.freedom / per_row, rounding);
      if (!of_joint) continue;
      result.log10_p =
          std::min(result.log10_p,
                   std::min(0.0, *of_joint + std::log10(static_cast<double>(scattering.size()))));
    }
  } else if (fit.measurements().sigma_source != SigmaSource::kAssumed) {
    // The stated sigma is the instrument's alone: half as much again allows for repeatability.
    const double scale2 = fit.noise_scale() * fit.noise_scale();
    result.testable = true;
    result.against = "sigma";
    result.log10_p =
        log10_chi2_survival(l.residual.squaredNorm() * scale2 / (1.5 * 1.5), l.freedom);
  }
  return result;
}

std::string words_of(const NoiseParts& noise, const Linearization& l, const Robot& robot) {
  const double reading = noise.reading * l.typical_sigma;
  std::vector<std::pair<double, std::size_t>> joints;  // scatter of a coordinate at the tool [m]
  std::array<std::vector<std::size_t>, 2> alike;       // pooled joints: rotary, sliding
  for (std::size_t k = 0; k < noise.joint.size(); ++k) {
    if (noise.is_pooled(k)) alike.at(robot.joints[k].prismatic ? 1 : 0).push_back(k);
    const double moved = noise.joint[k] *
                         l.displacement(l.geometry.col(l.layout.motor(static_cast<int>(k)))) /
                         std::sqrt(3.0);
    if (moved >= kToldFromReading * reading) joints.emplace_back(-moved, k);
  }
  std::ranges::sort(joints);
  std::string words;
  for (const auto& [moved, k] : joints) {
    std::vector<std::size_t> named{k};
    if (noise.is_pooled(k)) named = std::exchange(alike.at(robot.joints[k].prismatic ? 1 : 0), {});
    if (named.empty()) continue;  // already named with its pool
    const bool one = named.size() == 1, first = words.empty();
    words += std::string(first ? "" : ", ") + (one ? "joint " : "joints ");
    for (const std::size_t j : named)
      words += (j == named.front()  ? ""
                : j == named.back() ? " and "
                                    : ", ") +
               std::to_string(j + 1);
    if (first) words += one ? " repeats" : " repeat";
    char text[80];
    std::snprintf(text, sizeof text, " to %.3g %s%s", noise.joint[k] * 1e6,
                  robot.joints[k].prismatic ? "um" : "urad", one ? "" : " each");
    words += text;
  }
  const bool names_joints = !words.empty();
  if (names_joints) words += "; ";
  words += "readings scatter by " + micrometre_words(reading) + " a coordinate";
  if (l.sigma_rotation > 0.0) {
    char text[80];
    std::snprintf(text, sizeof text, ", orientations by %.3g urad an axis",
                  noise.orientation * l.sigma_rotation * 1e6);
    words += text;
  }
  if (noise.pose && *noise.pose >= kToldFromReading * reading)
    words += ", and those of one pose together by " + micrometre_words(*noise.pose);
  if (names_joints && l.poses.visits == l.poses.poses)
    words += " (an error of a joint that the model lacks would look the same: repeat some poses)";
  return words;
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

GrossCluster gross_errors_together(const Fit& fit) {
  constexpr std::size_t kFewest = 4;
  GrossCluster result;
  std::set<int> seen;
  std::vector<std::size_t> rows;  // one of each pose
  for (const RejectedRow& r : fit.rejected()) {
    if (seen.insert(fit.measurements().poses.pose_of_row[r.row]).second) rows.push_back(r.row);
  }
  if (rows.size() < kFewest) return result;
  const auto count = static_cast<double>(rows.size());
  const int joints = fit.robot().joint_count();
  for (int joint = 1; joint <= joints; ++joint) {
    if (fit.robot().is_passive(joint)) continue;
    const std::vector<double>& q = fit.state().column("q" + std::to_string(joint));
    double low = q[rows.front()], high = low;
    for (const std::size_t row : rows) {
      low = std::min(low, q[row]);
      high = std::max(high, q[row]);
    }
    const auto between =
        std::ranges::count_if(q, [&](double value) { return value >= low && value <= high; });
    const double width = static_cast<double>(between) / static_cast<double>(q.size());
    // The probability that n values, uniform between 0 and 1, span no more than w is
    // n w^(n-1) - (n-1) w^n.
    const double log10_p = std::log10(count - (count - 1.0) * width) +
                           (count - 1.0) * std::log10(width) +
                           std::log10(static_cast<double>(joints));
    if (log10_p < result.log10_p)
      result = {joint, static_cast<int>(rows.size()), low, high, log10_p};
  }
  return result;
}

std::string gross_words(const GrossCluster& cluster) {
  char text[160];
  std::snprintf(text, sizeof text,
                "%d poses kept out as gross errors all have q%d between %.3g and %.3g",
                cluster.poses, cluster.joint, cluster.low, cluster.high);
  return text;
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
