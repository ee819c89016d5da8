#include "fitter/inference/scatter_parts.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <map>

#include "fitter/common/dense.h"
#include "fitter/common/parallel.h"

namespace armtrue {
namespace {

using Eigen::Index;

constexpr int kScatterPasses = 5;
// In one pass, the variance of readings decreases at most to this share of its previous value.
constexpr double kLeastShare = 0.1;
// A part counts only if its variance is this many times the standard deviation of its estimate.
constexpr double kClearly = 3.0;
// The fit is assumed to leave at least this share of a residual's variance, which bounds the
// correction for leverage.
constexpr double kLeastLeft = 0.05;
// This many poses determine the variances to a few percent, which is sufficient.
constexpr std::size_t kMostPoses = 2000;
// A pose with more readings is split: the work grows with their cube.
constexpr std::size_t kReadingsTogether = 16;
constexpr std::size_t kTogether = 64;  // poses that one thread processes at a time

// Jacobian of some rows, restricted to the unknowns that they depend on.
struct Touched {
  std::vector<int> unknowns;
  Eigen::MatrixXd jacobian;  // equations × unknowns
};

Touched touched_by(const EvaluatedRows& evaluated, const std::vector<std::size_t>& rows,
                   int height) {
  Touched result;
  std::map<int, Index> place;
  for (const std::size_t r : rows) {
    for (const int unknown : evaluated.rows[r].unknowns) {
      if (place.try_emplace(unknown, static_cast<Index>(place.size())).second)
        result.unknowns.push_back(unknown);
    }
  }
  result.jacobian = Eigen::MatrixXd::Zero(static_cast<Index>(rows.size()) * height,
                                          static_cast<Index>(place.size()));
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const Design::Row& row = evaluated.rows[rows[i]];
    for (std::size_t u = 0; u < row.unknowns.size(); ++u) {
      result.jacobian.col(place.at(row.unknowns[u]))
          .segment(static_cast<Index>(i) * height, height) =
          row.jacobian.col(static_cast<Index>(u)).head(height);
    }
  }
  return result;
}

// Rows of `evaluated`, grouped by the number in `group_of_row` (indexed by the design's rows).
std::vector<std::vector<std::size_t>> grouped(const EvaluatedRows& evaluated,
                                              const std::vector<int>& group_of_row) {
  std::map<int, std::vector<std::size_t>> groups;
  for (std::size_t r = 0; r < evaluated.index.size(); ++r)
    groups[group_of_row[evaluated.index[r]]].push_back(r);
  std::vector<std::vector<std::size_t>> result;
  for (auto& [group, rows] : groups) result.push_back(std::move(rows));
  return result;
}

// Equations of some rows × joints: change of the readings by a unit of each joint.
Eigen::MatrixXd moved_by_joints(const EvaluatedRows& evaluated,
                                const std::vector<std::size_t>& rows, int height) {
  Eigen::MatrixXd result(static_cast<Index>(rows.size()) * height,
                         evaluated.by_joint.front().cols());
  for (std::size_t i = 0; i < rows.size(); ++i)
    result.middleRows(static_cast<Index>(i) * height, height) =
        evaluated.by_joint[rows[i]].topRows(height);
  return result;
}

// Equations of some rows × 3: change of the readings by a shift of the measured point.
Eigen::MatrixXd shifted(const Design& design, const EvaluatedRows& evaluated,
                        const std::vector<std::size_t>& rows) {
  const int height = design.residuals_per_row();
  Eigen::MatrixXd result(static_cast<Index>(rows.size()) * height, 3);
  for (std::size_t i = 0; i < rows.size(); ++i) {
    for (int c = 0; c < 3; ++c) {
      result.col(c).segment(static_cast<Index>(i) * height, height) =
          design.whiten(evaluated.index[rows[i]], Eigen::Matrix<double, 6, 1>::Unit(c))
              .head(height);
    }
  }
  return result;
}

ScatterColumns columns_of(const Design& design, const EvaluatedRows& evaluated,
                          const std::vector<std::size_t>& rows) {
  const Poses& poses = design.measurements().poses;
  const int height = design.residuals_per_row();
  const Eigen::MatrixXd moved = moved_by_joints(evaluated, rows, height);
  const Index joints = moved.cols();
  ScatterColumns result;
  std::map<int, Index> visit;
  for (const std::size_t r : rows)
    visit.try_emplace(poses.visit_of_row[evaluated.index[r]], static_cast<Index>(visit.size()));
  const auto visits = static_cast<Index>(visit.size());
  for (Index k = 0; k < joints; ++k)
    result.part.insert(result.part.end(), static_cast<std::size_t>(visits), k + 1);
  if (poses.any_repeated()) result.part.insert(result.part.end(), 3, joints + 1);
  result.columns = Eigen::MatrixXd::Zero(moved.rows(), static_cast<Index>(result.part.size()));
  if (poses.any_repeated()) result.columns.rightCols(3) = shifted(design, evaluated, rows);
  result.residual.resize(moved.rows());
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const Index at = static_cast<Index>(i) * height;
    result.residual.segment(at, height) = evaluated.rows[rows[i]].residual.head(height);
    for (int h = 0; h < height; ++h) result.own.push_back(h < 3 ? 0 : joints + 2);
    const Index own_visit = visit.at(poses.visit_of_row[evaluated.index[rows[i]]]);
    for (Index k = 0; k < joints; ++k) {
      result.columns.col(k * visits + own_visit).segment(at, height) =
          moved.col(k).segment(at, height);
    }
  }
  return result;
}

// Corrects the residual of a pose for leverage: r ← (I − H)^−½ r, where H (`share`) is the pose's
// block of the hat matrix.
void make_up_for(const Eigen::MatrixXd& share, Eigen::VectorXd& residual) {
  const SymmetricEigen left =
      symmetric_eigen(Eigen::MatrixXd::Identity(share.rows(), share.cols()) - share);
  residual = left.vectors * (left.vectors.transpose() * residual)
                                .cwiseQuotient(left.values.cwiseMax(kLeastLeft).cwiseSqrt());
}

// Residuals and scatter columns of at most kMostPoses poses, spread evenly over the file.
// `covariance`: of the unknowns; `variance`: of one whitened residual.
std::vector<ScatterColumns> scatter_of(const Design& design, const EvaluatedRows& evaluated,
                                       const std::vector<std::vector<std::size_t>>& poses,
                                       const Eigen::MatrixXd& covariance, double variance) {
  std::vector<std::vector<std::size_t>> pieces;
  const std::size_t stride = (poses.size() + kMostPoses - 1) / kMostPoses;
  for (std::size_t g = 0; g < poses.size(); g += stride) {
    const std::vector<std::size_t>& rows = poses[g];
    for (std::size_t first = 0; first < rows.size(); first += kReadingsTogether) {
      const std::size_t end = std::min(rows.size(), first + kReadingsTogether);
      pieces.emplace_back(rows.begin() + static_cast<std::ptrdiff_t>(first),
                          rows.begin() + static_cast<std::ptrdiff_t>(end));
    }
  }
  std::vector<ScatterColumns> result(pieces.size());
  in_pieces(pieces.size(), kTogether, [&](std::size_t first, std::size_t end) {
    for (std::size_t g = first; g < end; ++g) {
      result[g] = columns_of(design, evaluated, pieces[g]);
      const Touched touched = touched_by(evaluated, pieces[g], design.residuals_per_row());
      make_up_for(touched.jacobian * covariance(touched.unknowns, touched.unknowns) *
                      touched.jacobian.transpose() / variance,
                  result[g].residual);
    }
  });
  return result;
}

// The linear equations of the variances: information · variances = moments.
struct Moments {
  Eigen::MatrixXd information;
  Eigen::VectorXd moments;
};

void add(const ScatterColumns& pose, const Eigen::VectorXd& variance, Moments& sums) {
  const Index size = pose.residual.size();
  Eigen::MatrixXd covariance = Eigen::MatrixXd::Zero(size, size);
  for (Index e = 0; e < size; ++e)
    covariance(e, e) = variance[pose.own[static_cast<std::size_t>(e)]];
  for (std::size_t c = 0; c < pose.part.size(); ++c) {
    const auto column = pose.columns.col(static_cast<Index>(c));
    if (variance[pose.part[c]] > 0.0)
      covariance.noalias() += variance[pose.part[c]] * column * column.transpose();
  }
  Eigen::MatrixXd all(size, size + pose.columns.cols() + 1);
  all << Eigen::MatrixXd::Identity(size, size), pose.columns, pose.residual;
  const Eigen::MatrixXd white = Cholesky(std::move(covariance)).half_solve(std::move(all));
  const Index count = white.cols() - 1;
  const auto part = [&](Index c) {
    return c < size ? pose.own[static_cast<std::size_t>(c)]
                    : pose.part[static_cast<std::size_t>(c - size)];
  };
  const Eigen::MatrixXd products = white.leftCols(count).transpose() * white;
  for (Index a = 0; a < count; ++a) {
    sums.moments[part(a)] += products(a, count) * products(a, count);
    for (Index b = 0; b < count; ++b)
      sums.information(part(a), part(b)) += products(a, b) * products(a, b);
  }
}

// Solves for the variances. The least significant joint or pose part is set to 0 and the rest
// solved again, until all that remain exceed kClearly standard deviations.
Eigen::VectorXd clear_variances(const Moments& sums) {
  const Index last = sums.moments.size() - 1;
  std::vector<Index> there;
  for (Index i = 0; i <= last; ++i) {
    if (sums.information(i, i) > 0.0) there.push_back(i);
  }
  Eigen::VectorXd variance = Eigen::VectorXd::Zero(last + 1);
  while (true) {
    const ScaledCholesky factor(sums.information(there, there));
    const Eigen::VectorXd found = factor.solve(sums.moments(there));
    const Eigen::VectorXd spread = (2.0 * factor.inverse().diagonal()).cwiseSqrt();
    Index least = -1;
    for (Index i = 0; i < found.size(); ++i) {
      const Index p = there[static_cast<std::size_t>(i)];
      if (p == 0 || p == last || found[i] > kClearly * spread[i]) continue;
      if (least < 0 || found[i] * spread[least] < found[least] * spread[i]) least = i;
    }
    if (least < 0) {
      variance(there) = found;
      return variance;
    }
    there.erase(there.begin() + least);
  }
}

}  // namespace

Eigen::VectorXd estimate_scatter(const std::vector<ScatterColumns>& poses, int joints) {
  const Index parts = joints + 3;
  Eigen::VectorXd variance = Eigen::VectorXd::Zero(parts);
  variance[0] = variance[parts - 1] = 1.0;
  for (int pass = 0; pass < kScatterPasses; ++pass) {
    const Moments none{Eigen::MatrixXd::Zero(parts, parts), Eigen::VectorXd::Zero(parts)};
    std::vector<Moments> of_piece((poses.size() + kTogether - 1) / kTogether, none);
    in_pieces(poses.size(), kTogether, [&](std::size_t first, std::size_t end) {
      for (std::size_t g = first; g < end; ++g)
        add(poses[g], variance, of_piece[first / kTogether]);
    });
    Moments sums = none;
    for (const Moments& piece : of_piece) {
      sums.information += piece.information;
      sums.moments += piece.moments;
    }
    Eigen::VectorXd next = clear_variances(sums);
    for (const Index own : {Index{0}, parts - 1}) {
      if (sums.information(own, own) > 0.0)
        next[own] = std::max(next[own], kLeastShare * variance[own]);
    }
    variance = next;
  }
  return variance;
}

Eigen::MatrixXd with_scatter_in_parts(const Design& design, const EvaluatedRows& evaluated,
                                      const std::vector<PenaltyRow>& penalties,
                                      Eigen::MatrixXd covariance, double variance) {
  const int height = design.residuals_per_row();
  const int joints = static_cast<int>(evaluated.by_joint.front().cols());
  const Poses& poses = design.measurements().poses;
  const auto of_poses = grouped(evaluated, poses.pose_of_row);
  const Eigen::VectorXd scatter =
      estimate_scatter(scatter_of(design, evaluated, of_poses, covariance, variance), joints);
  if (scatter.segment(1, joints + 1).maxCoeff() <= 0.0) return covariance;

  // Derivatives of the solution: C Jᵀ / variance by a reading, C Pᵀ by a penalty's centre, where C
  // is the covariance under equal noise in all equations.
  const double reading = std::max(scatter[0], scatter[joints + 2]);
  const double alike = std::min(1.0, reading / variance);
  Eigen::MatrixXd beyond = Eigen::MatrixXd::Zero(covariance.rows(), covariance.cols());
  for (const PenaltyRow& row : penalties) {
    for (const auto& [a, by_a] : row.entries) {
      for (const auto& [b, by_b] : row.entries) beyond(a, b) += (1.0 - alike) * by_a * by_b;
    }
  }
  const auto add = [&](const std::vector<std::size_t>& rows, const Eigen::MatrixXd& part) {
    const Touched touched = touched_by(evaluated, rows, height);
    const Eigen::MatrixXd moved = touched.jacobian.transpose() * part / variance;
    beyond(touched.unknowns, touched.unknowns) += moved * moved.transpose();
  };
  const Eigen::VectorXd of_joints = scatter.segment(1, joints).cwiseSqrt();
  if (of_joints.maxCoeff() > 0.0) {
    for (const auto& rows : grouped(evaluated, poses.visit_of_row))
      add(rows, moved_by_joints(evaluated, rows, height) * of_joints.asDiagonal());
  }
  if (scatter[joints + 1] > 0.0) {
    for (const auto& rows : of_poses)
      add(rows, std::sqrt(scatter[joints + 1]) * shifted(design, evaluated, rows));
  }
  return alike * covariance + congruent(beyond, covariance);
}

}  // namespace armtrue
