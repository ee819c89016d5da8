#include "fitter/evidence/noise.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <map>

#include "fitter/solve/dense.h"
#include "fitter/solve/normal_equations.h"

namespace armtrue {
namespace {

// A part that fell to this share of the reading's own variance is none.
constexpr double kNone = 1e-8;
constexpr std::size_t kPosesLookedAt = 400;
// Of a standard deviation, for a ratio of squares: 1/4 climbs at every step, 1/2 is Fisher's and
// may swing.
constexpr double kStepExponent = 0.4;

// Columns of every part within the equations of one pose.
struct PoseParts {
  std::vector<Eigen::Index> equations;
  std::vector<Eigen::MatrixXd> joint;  // by joint: equations × visits
  Eigen::MatrixXd shared;              // equations × 3
};

std::vector<PoseParts> parts_of_poses(const Linearization& l) {
  std::vector<PoseParts> result;
  for (const std::vector<std::size_t>& rows : l.poses.rows_by_pose()) {
    PoseParts pose;
    std::map<int, Eigen::Index> visits;
    for (const std::size_t row : rows) {
      visits.try_emplace(l.poses.visit_of_row[row], static_cast<Eigen::Index>(visits.size()));
      for (int h = 0; h < l.height; ++h)
        pose.equations.push_back(static_cast<Eigen::Index>(row) * l.height + h);
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

Eigen::MatrixXd covariance_of(const PoseParts& pose, const NoiseParts& parts) {
  const auto size = static_cast<Eigen::Index>(pose.equations.size());
  Eigen::MatrixXd v = parts.reading * parts.reading * Eigen::MatrixXd::Identity(size, size);
  for (std::size_t k = 0; k < pose.joint.size(); ++k) {
    const double variance = k < parts.joint.size() ? parts.joint[k] * parts.joint[k] : 0.0;
    if (variance > 0.0) v.noalias() += variance * (pose.joint[k] * pose.joint[k].transpose());
  }
  if (parts.pose)
    v.noalias() += *parts.pose * *parts.pose * (pose.shared * pose.shared.transpose());
  return v;
}

}  // namespace

PoseWhitening::PoseWhitening(const Linearization& linearization, const NoiseParts& parts) {
  for (PoseParts& pose : parts_of_poses(linearization)) {
    const Eigen::LLT<Eigen::MatrixXd> root(covariance_of(pose, parts));
    const auto size = static_cast<Eigen::Index>(pose.equations.size());
    log_determinant_ += 2.0 * root.matrixLLT().diagonal().array().log().sum();
    blocks_.push_back(
        {std::move(pose.equations), root.matrixL().solve(Eigen::MatrixXd::Identity(size, size))});
  }
}

void PoseWhitening::apply(Eigen::Ref<Eigen::MatrixXd> columns) const {
  Eigen::VectorXd own;
  for (Eigen::Index c = 0; c < columns.cols(); ++c) {
    double* column = columns.col(c).data();
    for (const Block& block : blocks_) {
      const auto size = static_cast<Eigen::Index>(block.equations.size());
      own.resize(size);
      for (Eigen::Index e = 0; e < size; ++e)
        own[e] = column[block.equations[static_cast<std::size_t>(e)]];
      for (Eigen::Index e = 0; e < size; ++e) {
        column[block.equations[static_cast<std::size_t>(e)]] =
            block.inverse_root.row(e).head(e + 1).dot(own.head(e + 1));
      }
    }
  }
}

NoiseParts broad_noise(const Linearization& l, const Eigen::VectorXd& residual) {
  NoiseParts parts;
  const double per_equation = residual.squaredNorm() / static_cast<double>(residual.size());
  const double n = l.layout.joints;
  parts.reading = std::sqrt(0.5 * per_equation);
  for (int k = 0; k < l.layout.joints; ++k) {
    const double reach =
        l.geometry.col(l.layout.motor(k)).squaredNorm() / static_cast<double>(residual.size());
    parts.joint.push_back(reach > 0.0 ? std::sqrt(0.5 * per_equation / n / reach) : 0.0);
  }
  if (l.poses.any_repeated()) parts.pose = l.typical_sigma * std::sqrt(per_equation);
  return parts;
}

namespace {

// What the restricted likelihood compares for every part: reading, joints, pose.
struct Score {
  std::vector<double> above, below;
};

// The equations of a pose stand side by side, so that its share of a matrix is one piece of memory.
class RestrictedLikelihood {
 public:
  RestrictedLikelihood(const Linearization& l, const Eigen::MatrixXd& columns,
                       const Eigen::MatrixXd& precision, const Eigen::VectorXd& y)
      : l_(l), precision_(precision), poses_(parts_of_poses(l)) {
    std::vector<Eigen::Index> order;
    for (const PoseParts& pose : poses_)
      order.insert(order.end(), pose.equations.begin(), pose.equations.end());
    across_ = columns(order, Eigen::all).transpose();
    y_ = y(order);
  }

  Score score(const NoiseParts& parts) const;

 private:
  const Linearization& l_;
  const Eigen::MatrixXd& precision_;
  std::vector<PoseParts> poses_;
  Eigen::MatrixXd across_;  // unknowns × equations
  Eigen::VectorXd y_;
};

Score RestrictedLikelihood::score(const NoiseParts& parts) const {
  const PoseWhitening whitening(l_, parts);
  Eigen::MatrixXd white(across_.rows(), across_.cols());
  Eigen::VectorXd left(y_.size());
  Eigen::Index at = 0;
  for (const PoseWhitening::Block& block : whitening.blocks()) {
    const auto size = static_cast<Eigen::Index>(block.equations.size());
    const auto root = block.inverse_root.triangularView<Eigen::Lower>();
    white.middleCols(at, size).noalias() =
        across_.middleCols(at, size).lazyProduct(block.inverse_root.transpose());
    left.segment(at, size) = root * y_.segment(at, size);
    at += size;
  }
  const ScaledCholesky factor(precision_ + square_across(white));
  left -= white.transpose() * factor.solve(white * left);

  // The sums that the steps compare are averages over poses: some hundreds of them say as much as
  // all.
  const std::size_t stride = std::max<std::size_t>(1, poses_.size() / kPosesLookedAt);
  std::vector<Eigen::Index> looked_at;
  at = 0;
  for (std::size_t g = 0; g < poses_.size(); ++g) {
    const auto size = static_cast<Eigen::Index>(poses_[g].equations.size());
    for (Eigen::Index e = 0; e < size && g % stride == 0; ++e) looked_at.push_back(at + e);
    at += size;
  }
  const Eigen::MatrixXd half = factor.half_solve(white(Eigen::all, looked_at));
  const Eigen::VectorXd seen = left(looked_at);
  Score score{std::vector<double>(parts.joint.size() + 2, 0.0), {}};
  score.below = score.above;
  at = 0;
  for (std::size_t g = 0; g < poses_.size(); g += stride) {
    const PoseParts& pose = poses_[g];
    const auto size = static_cast<Eigen::Index>(pose.equations.size());
    const Eigen::MatrixXd known = half.middleCols(at, size).transpose() * half.middleCols(at, size);
    const Eigen::VectorXd own = seen.segment(at, size);
    const auto root = whitening.blocks()[g].inverse_root.triangularView<Eigen::Lower>();
    const auto add = [&](std::size_t part, const Eigen::MatrixXd& z) {
      const Eigen::MatrixXd white_z = root * z;
      score.above[part] += (white_z.transpose() * own).squaredNorm();
      score.below[part] += white_z.squaredNorm() -
                           (white_z.transpose() * known).cwiseProduct(white_z.transpose()).sum();
    };
    add(0, Eigen::MatrixXd::Identity(size, size));
    for (std::size_t k = 0; k < pose.joint.size(); ++k) {
      if (parts.joint[k] > 0.0) add(k + 1, pose.joint[k]);
    }
    if (parts.pose) add(parts.joint.size() + 1, pose.shared);
    at += size;
  }
  return score;
}

}  // namespace

NoiseParts estimate_noise(const Linearization& l, const Eigen::MatrixXd& columns,
                          const Eigen::MatrixXd& precision, const Eigen::VectorXd& y,
                          const NoiseParts& start, int steps) {
  const RestrictedLikelihood likelihood(l, columns, precision, y);
  NoiseParts parts = start;
  parts.joint.resize(static_cast<std::size_t>(l.layout.joints), 0.0);
  for (int step = 0; step < steps; ++step) {
    const Score score = likelihood.score(parts);
    const auto factor_of = [&](std::size_t part) {
      return score.below[part] > 0.0
                 ? std::pow(score.above[part] / score.below[part], kStepExponent)
                 : 0.0;
    };
    parts.reading *= factor_of(0);
    for (std::size_t k = 0; k < parts.joint.size(); ++k) {
      parts.joint[k] *= factor_of(k + 1);
      const double reach = l.geometry.col(l.layout.motor(static_cast<int>(k))).squaredNorm() /
                           static_cast<double>(y.size());
      if (parts.joint[k] * parts.joint[k] * reach < kNone * parts.reading * parts.reading)
        parts.joint[k] = 0.0;
    }
    if (parts.pose) *parts.pose *= factor_of(parts.joint.size() + 1);
  }
  return parts;
}

}  // namespace armtrue
