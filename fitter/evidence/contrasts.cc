#include "fitter/evidence/contrasts.h"

#include <map>
#include <utility>
#include <vector>

#include "fitter/common/dense.h"

namespace armtrue {
namespace {

// A column counts as constant within poses if its differences there have less than this share of
// its squares.
constexpr double kConstant = 1e-9;
constexpr double kRidge =
    1e-9;  // share of a column's squares, for columns that are linearly dependent

// Equations of one pose, and an orthonormal basis of changes common to all its readings of a
// reflector.
struct Shared {
  std::vector<Eigen::Index> equations;
  Eigen::MatrixXd basis;
};

std::vector<Shared> repeated_poses(const Linearization& l, const std::vector<int>& target,
                                   const PoseWhitening& whitening) {
  std::vector<Shared> result;
  for (const PoseWhitening::Block& block : whitening.blocks()) {
    // By reflector and axis: the column of their common change.
    std::map<std::pair<int, Eigen::Index>, Eigen::Index> place;
    const auto key = [&](Eigen::Index e) {
      return std::pair{target[static_cast<std::size_t>(e / l.height)], e % l.height};
    };
    for (const Eigen::Index e : block.equations)
      place.try_emplace(key(e), static_cast<Eigen::Index>(place.size()));
    const auto size = static_cast<Eigen::Index>(block.equations.size());
    const auto common = static_cast<Eigen::Index>(place.size());
    if (common == size) continue;
    Eigen::MatrixXd shared = Eigen::MatrixXd::Zero(size, common);
    for (Eigen::Index i = 0; i < size; ++i) {
      const Eigen::Index e = block.equations[static_cast<std::size_t>(i)];
      const Eigen::Index row = e / l.height;
      shared(i, place.at(key(e))) = l.translation.middleRows(row * l.height, 3).norm();
    }
    shared = block.inverse_root.triangularView<Eigen::Lower>() * shared;
    const Cholesky root(square(shared));
    result.push_back({block.equations, root.half_solve(shared.transpose()).transpose()});
  }
  return result;
}

}  // namespace

IdleContrasts idle_contrasts(const Linearization& l, const std::vector<int>& target,
                             const PoseWhitening& whitening, const Eigen::MatrixXd& white) {
  const std::vector<Shared> poses = repeated_poses(l, target, whitening);
  IdleContrasts idle;
  if (poses.empty()) return idle;
  Eigen::Index equations = 0;
  for (const Shared& pose : poses) {
    equations += static_cast<Eigen::Index>(pose.equations.size());
    idle.freedom += static_cast<double>(pose.basis.rows() - pose.basis.cols());
  }
  Eigen::VectorXd contrast(equations);
  std::vector<Eigen::VectorXd> kept;
  for (Eigen::Index c = 0; c < white.cols(); ++c) {
    Eigen::Index at = 0;
    for (const Shared& pose : poses) {
      const auto size = static_cast<Eigen::Index>(pose.equations.size());
      const Eigen::VectorXd own = white(pose.equations, c);
      contrast.segment(at, size) = own - pose.basis * (pose.basis.transpose() * own);
      at += size;
    }
    if (c + 1 == white.cols() || contrast.squaredNorm() > kConstant * white.col(c).squaredNorm())
      kept.push_back(contrast);
  }
  const auto width = static_cast<Eigen::Index>(kept.size()) - 1;
  Eigen::MatrixXd all(equations, width + 1);
  for (Eigen::Index c = 0; c <= width; ++c) all.col(c) = kept[static_cast<std::size_t>(c)];
  const Eigen::MatrixXd products = square(all);
  idle.squares = products(width, width);
  if (width == 0) return idle;
  Eigen::MatrixXd information = products.topLeftCorner(width, width);
  information.diagonal() *= 1.0 + kRidge;
  const ScaledCholesky factor(information);
  const Eigen::VectorXd gradient = products.col(width).head(width);
  idle.squares = std::max(0.0, idle.squares - gradient.dot(factor.solve(gradient)));
  idle.freedom = std::max(
      0.0, idle.freedom - factor.solve_matrix(products.topLeftCorner(width, width)).trace());
  return idle;
}

}  // namespace armtrue
