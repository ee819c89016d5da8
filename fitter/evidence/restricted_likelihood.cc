#include "fitter/evidence/restricted_likelihood.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <utility>

#include "fitter/common/dense.h"
#include "fitter/common/parallel.h"
#include "fitter/design/normal_equations.h"

namespace armtrue {
namespace {

constexpr std::size_t kPosesLookedAt = 400;
constexpr std::size_t kPosesTogether = 100;  // worked out by one thread at a time
constexpr Eigen::Index kFewestEquations = 3600, kEquationsPerColumn = 4;

Eigen::MatrixXd covariance_of(const PoseParts& pose, const NoiseParts& parts) {
  const Eigen::Index size = pose.shared.rows();
  Eigen::MatrixXd v = Eigen::MatrixXd::Zero(size, size);
  for (Eigen::Index e = 0; e < size; ++e)
    v(e, e) =
        std::pow(pose.turns[static_cast<std::size_t>(e)] ? parts.orientation : parts.reading, 2);
  for (std::size_t k = 0; k < pose.joint.size(); ++k) {
    const double variance = k < parts.joint.size() ? parts.joint[k] * parts.joint[k] : 0.0;
    if (variance > 0.0) v.noalias() += variance * (pose.joint[k] * pose.joint[k].transpose());
  }
  if (parts.pose)
    v.noalias() += *parts.pose * *parts.pose * (pose.shared * pose.shared.transpose());
  return v;
}

// A few equations for every column determine the variances to a few percent; the time grows in
// proportion to their number.
std::size_t stride_of(const Linearization& l, Eigen::Index columns) {
  const Eigen::Index wanted = std::max(kFewestEquations, kEquationsPerColumn * columns);
  return static_cast<std::size_t>(std::max<Eigen::Index>(1, l.equations() / wanted));
}

void add_pose(const PoseParts& pose, const NoiseParts& parts, const Eigen::MatrixXd& inverse_root,
              const Eigen::MatrixXd& free, const Eigen::VectorXd& left, Score& score) {
  const auto root = inverse_root.triangularView<Eigen::Lower>();
  const auto size = static_cast<Eigen::Index>(pose.equations.size());
  std::vector<std::pair<Eigen::Index, Eigen::MatrixXd>> columns;  // of each part, whitened
  for (const bool turns : {false, true}) {
    std::vector<Eigen::Index> own;
    for (Eigen::Index e = 0; e < size; ++e) {
      if (pose.turns[static_cast<std::size_t>(e)] == turns) own.push_back(e);
    }
    if (!own.empty())
      columns.emplace_back(turns ? score.slope.size() - 1 : 0, inverse_root(Eigen::all, own));
  }
  for (std::size_t k = 0; k < pose.joint.size(); ++k) {
    if (parts.joint[k] > 0.0)
      columns.emplace_back(static_cast<Eigen::Index>(k) + 1, root * pose.joint[k]);
  }
  if (parts.pose && *parts.pose > 0.0)
    columns.emplace_back(score.slope.size() - 2, root * pose.shared);
  for (const auto& [part, own] : columns) {
    score.slope[part] += 0.5 * (own.transpose() * left).squaredNorm();
    const Eigen::MatrixXd freed = free * own;
    score.slope[part] -= 0.5 * own.cwiseProduct(freed).sum();
    for (const auto& [other, its] : columns)
      score.information(part, other) += 0.5 * (its.transpose() * freed).squaredNorm();
  }
}

}  // namespace

std::vector<PoseParts> parts_of_poses(const Linearization& l, std::size_t stride) {
  std::vector<PoseParts> result;
  const std::vector<std::vector<std::size_t>> all = l.poses.rows_by_pose();
  for (std::size_t g = 0; g < all.size(); g += stride) {
    const std::vector<std::size_t>& rows = all[g];
    PoseParts pose;
    std::map<int, Eigen::Index> visits;
    for (const std::size_t row : rows) {
      visits.try_emplace(l.poses.visit_of_row[row], static_cast<Eigen::Index>(visits.size()));
      for (int h = 0; h < l.height; ++h) {
        if (h >= kPositionEquations && l.rotation_is_copied[row]) break;
        pose.equations.push_back(static_cast<Eigen::Index>(row) * l.height + h);
        pose.turns.push_back(h >= kPositionEquations);
      }
    }
    const auto size = static_cast<Eigen::Index>(pose.equations.size());
    pose.shared = l.translation(pose.equations, Eigen::all);
    for (int k = 0; k < l.layout.joints; ++k) {
      Eigen::MatrixXd columns =
          Eigen::MatrixXd::Zero(size, static_cast<Eigen::Index>(visits.size()));
      for (Eigen::Index e = 0; e < size; ++e) {
        const Eigen::Index equation = pose.equations[static_cast<std::size_t>(e)];
        const auto row = static_cast<std::size_t>(equation / l.height);
        columns(e, visits.at(l.poses.visit_of_row[row])) = l.geometry(equation, l.layout.motor(k));
      }
      pose.joint.push_back(std::move(columns));
    }
    result.push_back(std::move(pose));
  }
  return result;
}

Eigen::MatrixXd inverse_root_of(const PoseParts& pose, const NoiseParts& parts) {
  const Eigen::Index size = pose.shared.rows();
  return Cholesky(covariance_of(pose, parts)).half_solve(Eigen::MatrixXd::Identity(size, size));
}

Eigen::VectorXd variances_of(const NoiseParts& parts) {
  const auto joints = static_cast<Eigen::Index>(parts.joint.size());
  Eigen::VectorXd variance(joints + 3);
  variance[0] = parts.reading * parts.reading;
  for (Eigen::Index k = 0; k < joints; ++k)
    variance[k + 1] = std::pow(parts.joint[static_cast<std::size_t>(k)], 2);
  variance[joints + 1] = parts.pose ? *parts.pose * *parts.pose : 0.0;
  variance[joints + 2] = parts.orientation * parts.orientation;
  return variance;
}

RestrictedLikelihood::RestrictedLikelihood(const Linearization& l, const Eigen::MatrixXd& columns,
                                           const Eigen::MatrixXd& precision,
                                           const Eigen::VectorXd& y)
    : precision_(precision), poses_(parts_of_poses(l, stride_of(l, columns.cols()))) {
  std::vector<Eigen::Index> order;
  for (const PoseParts& pose : poses_) {
    first_.push_back(static_cast<Eigen::Index>(order.size()));
    order.insert(order.end(), pose.equations.begin(), pose.equations.end());
  }
  across_ = columns(order, Eigen::all).transpose();
  y_ = y(order);
}

Score RestrictedLikelihood::score(const NoiseParts& parts) const {
  std::vector<Eigen::MatrixXd> roots(poses_.size());
  Eigen::MatrixXd white(across_.rows(), across_.cols());
  Eigen::VectorXd left(y_.size());
  in_pieces(poses_.size(), kPosesTogether, [&](std::size_t first, std::size_t end) {
    for (std::size_t g = first; g < end; ++g) {
      roots[g] = inverse_root_of(poses_[g], parts);
      const Eigen::Index at = first_[g], size = roots[g].rows();
      white.middleCols(at, size).noalias() =
          across_.middleCols(at, size).lazyProduct(roots[g].transpose());
      left.segment(at, size) = roots[g].triangularView<Eigen::Lower>() * y_.segment(at, size);
    }
  });
  const ScaledCholesky factor(precision_ + square_across(white));
  const Eigen::VectorXd moment = white * left;
  const Eigen::VectorXd coefficients = factor.solve(moment);
  double value = -0.5 * (left.squaredNorm() - moment.dot(coefficients) + factor.log_determinant());
  for (const Eigen::MatrixXd& root : roots) value += root.diagonal().array().log().sum();
  left -= white.transpose() * coefficients;

  // A few hundred poses determine the averages of slope and information as well as all.
  const std::size_t stride = std::max<std::size_t>(1, poses_.size() / kPosesLookedAt);
  std::vector<std::size_t> looked_at;
  std::vector<Eigen::Index> equations, place;
  for (std::size_t g = 0; g < poses_.size(); g += stride) {
    looked_at.push_back(g);
    place.push_back(static_cast<Eigen::Index>(equations.size()));
    for (Eigen::Index e = 0; e < roots[g].rows(); ++e) equations.push_back(first_[g] + e);
  }
  const Eigen::MatrixXd half = factor.half_solve(white(Eigen::all, equations));
  const auto count = static_cast<Eigen::Index>(parts.joint.size()) + 3;
  std::vector<Score> of_pose(
      looked_at.size(), {0.0, Eigen::VectorXd::Zero(count), Eigen::MatrixXd::Zero(count, count)});
  in_pieces(looked_at.size(), kPosesTogether, [&](std::size_t first, std::size_t end) {
    for (std::size_t k = first; k < end; ++k) {
      const std::size_t g = looked_at[k];
      const Eigen::Index size = roots[g].rows();
      const auto own = half.middleCols(place[k], size);
      const Eigen::MatrixXd free = Eigen::MatrixXd::Identity(size, size) - own.transpose() * own;
      add_pose(poses_[g], parts, roots[g], free, left.segment(first_[g], size), of_pose[k]);
    }
  });
  Score score{value, Eigen::VectorXd::Zero(count), Eigen::MatrixXd::Zero(count, count)};
  for (const Score& own : of_pose) {
    score.slope += own.slope;
    score.information += own.information;
  }
  // The information, and with it the certainty of a variance, is that of all poses in `poses_`.
  const double all = static_cast<double>(poses_.size()) / static_cast<double>(looked_at.size());
  score.slope *= all;
  score.information *= all;
  return score;
}

}  // namespace armtrue
