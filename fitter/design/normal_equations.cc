#include "fitter/design/normal_equations.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <utility>

#include "fitter/common/dense.h"
#include "fitter/common/parallel.h"

namespace armtrue {

std::vector<PenaltyRow> penalty_rows(const Design& design, double smoothness_sigma) {
  std::vector<PenaltyRow> rows;
  const Model& model = design.model();
  for (std::size_t u = 0; u < design.free_parameters().size(); ++u) {
    const Parameter& p = model.parameters[static_cast<std::size_t>(design.free_parameters()[u])];
    if (p.prior_sigma > 0.0)
      rows.push_back({{{static_cast<int>(u), 1.0 / p.prior_sigma}}, p.prior_mean / p.prior_sigma});
  }
  for (std::size_t j = 0; j < model.nonlinear.size(); ++j) {
    // Wide: it only prevents a singular system if an unknown moves nothing, because its
    // coefficients are zero.
    const NonlinearParameter& p = model.nonlinear[j];
    const double sigma = p.upper - p.lower;
    rows.push_back(
        {{{static_cast<int>(design.free_parameters().size() + j), 1.0 / sigma}}, p.value / sigma});
  }
  std::map<std::string, int> unknowns;
  for (std::size_t i = 0; i < model.parameters.size(); ++i)
    unknowns[model.parameters[i].name] = design.unknown_of(static_cast<int>(i));
  for (const Penalty& penalty : model.penalties) {
    const double sigma = penalty.smoothness ? penalty.sigma * smoothness_sigma : penalty.sigma;
    PenaltyRow row;
    for (const auto& [name, factor] : penalty.row) {
      if (const int unknown = unknowns.at(name); unknown >= 0)
        row.entries.emplace_back(unknown, factor / sigma);
    }
    if (!row.entries.empty()) rows.push_back(std::move(row));
  }
  return rows;
}

double PenaltyRow::residual(const std::vector<double>& values) const {
  double left = -target;
  for (const auto& [unknown, factor] : entries)
    left += factor * values[static_cast<std::size_t>(unknown)];
  return left;
}

namespace {

// Columns of the information are distributed to the jobs in groups of this size. Each job adds all
// rows to its own columns, so that the order of summation does not depend on the number of jobs.
constexpr int kColumnsTogether = 16;
// Products of unknowns that more than this share of the rows read are left to the BLAS, so many
// rows at a time. Of the nodes of tables a row reads only a few.
constexpr double kDense = 0.5;
constexpr std::size_t kRowsTogether = 1024;

// By unknown: whether most rows read it.
std::vector<bool> dense_unknowns(const std::vector<const Design::Row*>& rows,
                                 Eigen::Index unknowns) {
  std::vector<std::size_t> readers(static_cast<std::size_t>(unknowns));
  for (const Design::Row* row : rows) {
    for (const int u : row->unknowns) ++readers[static_cast<std::size_t>(u)];
  }
  std::vector<bool> dense;
  for (const std::size_t count : readers)
    dense.push_back(static_cast<double>(count) > kDense * static_cast<double>(rows.size()));
  return dense;
}

// Adds the products of dense unknowns with one another.
void add_dense(const std::vector<const Design::Row*>& rows, int residuals,
               const std::vector<bool>& dense, Eigen::MatrixXd& information) {
  std::vector<Eigen::Index> place(dense.size(), -1), unknowns;
  for (std::size_t u = 0; u < dense.size(); ++u) {
    if (!dense[u]) continue;
    place[u] = static_cast<Eigen::Index>(unknowns.size());
    unknowns.push_back(static_cast<Eigen::Index>(u));
  }
  const auto width = static_cast<Eigen::Index>(unknowns.size());
  for (std::size_t first = 0; first < rows.size(); first += kRowsTogether) {
    throw_if_cancelled();
    const std::size_t count = std::min(kRowsTogether, rows.size() - first);
    Eigen::MatrixXd across =
        Eigen::MatrixXd::Zero(width, static_cast<Eigen::Index>(count) * residuals);
    for (std::size_t i = 0; i < count; ++i) {
      const Design::Row& row = *rows[first + i];
      for (std::size_t u = 0; u < row.unknowns.size(); ++u) {
        const Eigen::Index at = place[static_cast<std::size_t>(row.unknowns[u])];
        if (at < 0) continue;
        across.row(at).segment(static_cast<Eigen::Index>(i) * residuals, residuals) =
            row.jacobian.col(static_cast<Eigen::Index>(u)).head(residuals).transpose();
      }
    }
    const Eigen::MatrixXd products = square_across(across);
    for (Eigen::Index b = 0; b < width; ++b) {
      for (Eigen::Index a = b; a < width; ++a)
        information(unknowns[static_cast<std::size_t>(a)], unknowns[static_cast<std::size_t>(b)]) +=
            products(a, b);
    }
  }
}

// Consecutive unknowns at consecutive places of a row, such as two neighbouring nodes of a table.
struct Run {
  Eigen::Index place, count;
  int unknown;  // the first one
};

// Adds a row's share of JᵀJ to the columns of one job, except products of two dense unknowns. Fills
// only the lower triangle.
class SquareAdder {
 public:
  SquareAdder(Eigen::MatrixXd& information, int residuals, const std::vector<bool>& dense, int job,
              int jobs)
      : information_(information),
        residuals_(residuals),
        dense_(dense),
        job_(job),
        jobs_(jobs),
        across_(information.cols(), 6),
        products_(information.cols()) {}

  void add(const Design::Row& row) {
    touched_ = 0;
    runs_.clear();
    take(row, false);
    const std::size_t sparse = runs_.size();
    if (sparse == 0) return;
    take(row, true);
    for (std::size_t r = 0; r < sparse; ++r) {
      for (Eigen::Index k = 0; k < runs_[r].count; ++k) {
        if ((runs_[r].unknown + static_cast<int>(k)) / kColumnsTogether % jobs_ == job_)
          add_products(r, k);
      }
    }
  }

 private:
  // Appends the row's columns of dense unknowns, or of the others.
  void take(const Design::Row& row, bool dense) {
    const std::size_t begun = runs_.size();
    for (std::size_t u = 0; u < row.unknowns.size(); ++u) {
      const int unknown = row.unknowns[u];
      if (dense_[static_cast<std::size_t>(unknown)] != dense) continue;
      across_.row(touched_) = row.jacobian.col(static_cast<Eigen::Index>(u)).transpose();
      if (runs_.size() == begun ||
          unknown != runs_.back().unknown + static_cast<int>(runs_.back().count))
        runs_.push_back({touched_, 0, unknown});
      ++runs_.back().count;
      ++touched_;
    }
  }

  // Adds products of the k-th unknown of a run with itself and all that follow in the row.
  void add_products(std::size_t first, Eigen::Index k) {
    const Eigen::Index own = runs_[first].place + k, left = touched_ - own;
    const Eigen::Index unknown = runs_[first].unknown + k;
    auto products = products_.head(left);
    products = across_(own, 0) * across_.col(0).segment(own, left);
    for (int r = 1; r < residuals_; ++r)
      products += across_(own, r) * across_.col(r).segment(own, left);
    information_.col(unknown).segment(unknown, runs_[first].count - k) +=
        products.head(runs_[first].count - k);
    for (std::size_t r = first + 1; r < runs_.size(); ++r) {
      const auto part = products.segment(runs_[r].place - own, runs_[r].count);
      if (runs_[r].unknown > unknown) {
        information_.col(unknown).segment(runs_[r].unknown, runs_[r].count) += part;
      } else {
        information_.row(unknown).segment(runs_[r].unknown, runs_[r].count) += part.transpose();
      }
    }
  }

  Eigen::MatrixXd& information_;
  int residuals_;
  const std::vector<bool>& dense_;
  int job_, jobs_;
  // Of the present row. across_: its Jacobian, contiguous along the unknowns.
  std::vector<Run> runs_;
  Eigen::Index touched_ = 0;
  Eigen::Matrix<double, Eigen::Dynamic, 6> across_;
  Eigen::VectorXd products_;
};

void add_gradient(const Design::Row& row, int residuals, Eigen::VectorXd& gradient) {
  for (std::size_t u = 0; u < row.unknowns.size(); ++u) {
    gradient[row.unknowns[u]] += row.jacobian.col(static_cast<Eigen::Index>(u))
                                     .head(residuals)
                                     .dot(row.residual.head(residuals));
  }
}

}  // namespace

void NormalEquations::add(const std::vector<const Design::Row*>& added, int residuals) {
  for (const Design::Row* row : added) {
    cost += row->residual.head(residuals).squaredNorm();
    position_cost += row->residual.head<3>().squaredNorm();
    add_gradient(*row, residuals, gradient);
  }
  rows += added.size();
  const std::vector<bool> dense = dense_unknowns(added, information.cols());
  add_dense(added, residuals, dense, information);
  if (std::ranges::find(dense, false) == dense.end()) return;
  const std::size_t jobs = processors();
  in_parallel(jobs, [&](std::size_t job) {
    SquareAdder adder(information, residuals, dense, static_cast<int>(job), static_cast<int>(jobs));
    for (const Design::Row* row : added) {
      throw_if_cancelled();
      adder.add(*row);
    }
  });
}

double equations_that_count(double rows, double squares, double position_squares) {
  const double per_row =
      position_squares > 0.0 ? 3.0 * std::min(2.0, squares / position_squares) : 3.0;
  return rows * per_row;
}

void NormalEquations::add(const PenaltyRow& row, const std::vector<double>& values) {
  const double left = row.residual(values);
  for (const auto& [ua, fa] : row.entries) {
    gradient[ua] += fa * left;
    for (const auto& [ub, fb] : row.entries) {
      if (ub <= ua) information(ua, ub) += fa * fb;
    }
  }
}

EvaluatedRows evaluate_rows(const Design& design) {
  EvaluatedRows result;
  std::vector<std::size_t> place(design.rows());
  for (std::size_t i = 0; i < design.rows(); ++i) {
    place[i] = result.index.size();
    if (design.weights()[i] > 0.0) result.index.push_back(i);
  }
  result.rows.resize(result.index.size());
  result.by_joint.resize(result.index.size());
  const CoordinateLayout layout = design.kinematics().layout();
  design.each_row(true, [&](std::size_t i, Design::Row& row, const auto& workspace) {
    if (design.weights()[i] <= 0.0) return;
    auto& by_joint = result.by_joint[place[i]];
    by_joint.resize(6, layout.joints);
    for (int k = 0; k < layout.joints; ++k)
      by_joint.col(k) = design.whiten(i, workspace.geometric.col(layout.motor(k)));
    std::swap(result.rows[place[i]], row);
  });
  return result;
}

NormalEquations accumulate(const Design& design, const EvaluatedRows& evaluated) {
  NormalEquations equations(design.unknowns());
  std::vector<const Design::Row*> rows;
  for (const Design::Row& row : evaluated.rows) rows.push_back(&row);
  equations.add(rows, design.residuals_per_row());
  return equations;
}

NormalEquations accumulate(const Design& design) {
  return accumulate(design, evaluate_rows(design));
}

Eigen::VectorXd gradient_of(const Design& design) {
  Eigen::VectorXd gradient = Eigen::VectorXd::Zero(design.unknowns());
  for (const Design::Row& row : evaluate_rows(design).rows)
    add_gradient(row, design.residuals_per_row(), gradient);
  return gradient;
}

double squared_residuals(const Design& design) {
  std::vector<double> squares(design.rows());
  design.each_row(false, [&](std::size_t i, const Design::Row& row, const auto&) {
    squares[i] = row.residual.squaredNorm();
  });
  return std::accumulate(squares.begin(), squares.end(), 0.0);
}

namespace {

Eigen::VectorXd scale_of(const Eigen::MatrixXd& lower) {
  return lower.diagonal().unaryExpr([](double d) { return d > 0.0 ? 1.0 / std::sqrt(d) : 1.0; });
}

// Adds a ridge of rounding size: exact dependencies have been removed before, by rank.
Eigen::MatrixXd scaled_with_ridge(Eigen::MatrixXd lower, const Eigen::VectorXd& scale) {
  for (Eigen::Index c = 0; c < lower.cols(); ++c) {
    const Eigen::Index below = lower.rows() - c;
    lower.col(c).tail(below).array() *= scale[c] * scale.tail(below).array();
  }
  lower.diagonal().array() += 1e-14;
  return lower;
}

}  // namespace

ScaledCholesky::ScaledCholesky(Eigen::MatrixXd lower)
    : scale_(scale_of(lower)), factor_(scaled_with_ridge(std::move(lower), scale_)) {}

Eigen::VectorXd ScaledCholesky::solve(const Eigen::VectorXd& right) const {
  return scale_.cwiseProduct(factor_.solve(scale_.cwiseProduct(right)));
}

Eigen::MatrixXd ScaledCholesky::solve_matrix(const Eigen::MatrixXd& right) const {
  return scale_.asDiagonal() * factor_.solve_matrix(scale_.asDiagonal() * right);
}

Eigen::MatrixXd ScaledCholesky::inverse() const { return square_of_triangle(inverse_root()); }

Eigen::MatrixXd ScaledCholesky::inverse_root() const {
  Eigen::MatrixXd root = inverse_of_triangle(factor_.lower());
  root *= scale_.asDiagonal();
  return root;
}

Eigen::MatrixXd ScaledCholesky::half_solve(const Eigen::MatrixXd& right) const {
  return factor_.half_solve(scale_.asDiagonal() * right);
}

double ScaledCholesky::log_determinant() const {
  return 2.0 * factor_.lower().diagonal().array().log().sum() - 2.0 * scale_.array().log().sum();
}

}  // namespace armtrue
