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
  Eigen::MatrixXd own;
  for (const Block& block : blocks_) {
    own = columns(block.equations, Eigen::all);
    columns(block.equations, Eigen::all) = block.inverse_root.triangularView<Eigen::Lower>() * own;
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

NoiseParts estimate_noise(const Linearization& l, const Eigen::MatrixXd& columns,
                          const Eigen::MatrixXd& precision, const Eigen::VectorXd& y,
                          const NoiseParts& start, int steps) {
  const std::vector<PoseParts> poses = parts_of_poses(l);
  NoiseParts parts = start;
  parts.joint.resize(static_cast<std::size_t>(l.layout.joints), 0.0);
  // The sums that the steps compare are averages over poses: some hundreds of them say as much as
  // all.
  const std::size_t stride = std::max<std::size_t>(1, poses.size() / kPosesLookedAt);
  for (int step = 0; step < steps; ++step) {
    const PoseWhitening whitening(l, parts);
    Eigen::MatrixXd x = columns;
    Eigen::VectorXd white = y;
    whitening.apply(x);
    whitening.apply(white);
    Eigen::MatrixXd information = precision + transpose_times(x, x);
    const ScaledCholesky factor(information);
    const Eigen::Index width = x.cols();
    const Eigen::MatrixXd half = factor.half_solve(Eigen::MatrixXd::Identity(width, width));
    const Eigen::VectorXd left = white - x * (half.transpose() * (half * (x.transpose() * white)));
    const Eigen::MatrixXd turned = half.transpose();
    const std::size_t count = parts.joint.size() + 2;
    std::vector<double> above(count, 0.0), below(count, 0.0);
    for (std::size_t g = 0; g < poses.size(); g += stride) {
      const PoseParts& pose = poses[g];
      const PoseWhitening::Block& block = whitening.blocks()[g];
      const Eigen::MatrixXd u = x(pose.equations, Eigen::all) * turned;
      const Eigen::VectorXd r = left(pose.equations);
      const auto add = [&](std::size_t part, const Eigen::MatrixXd& z) {
        const Eigen::MatrixXd zw = block.inverse_root.triangularView<Eigen::Lower>() * z;
        above[part] += (zw.transpose() * r).squaredNorm();
        below[part] += zw.squaredNorm() - (u.transpose() * zw).squaredNorm();
      };
      const auto size = static_cast<Eigen::Index>(pose.equations.size());
      add(0, Eigen::MatrixXd::Identity(size, size));
      for (std::size_t k = 0; k < pose.joint.size(); ++k) {
        if (parts.joint[k] > 0.0) add(k + 1, pose.joint[k]);
      }
      if (parts.pose) add(count - 1, pose.shared);
    }
    const auto factor_of = [&](std::size_t part) {
      return below[part] > 0.0 ? std::pow(above[part] / below[part], kStepExponent) : 0.0;
    };
    parts.reading *= factor_of(0);
    for (std::size_t k = 0; k < parts.joint.size(); ++k) {
      parts.joint[k] *= factor_of(k + 1);
      const double reach = l.geometry.col(l.layout.motor(static_cast<int>(k))).squaredNorm() /
                           static_cast<double>(y.size());
      if (parts.joint[k] * parts.joint[k] * reach < kNone * parts.reading * parts.reading)
        parts.joint[k] = 0.0;
    }
    if (parts.pose) *parts.pose *= factor_of(count - 1);
  }
  return parts;
}

}  // namespace armtrue
