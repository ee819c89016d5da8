#include "fitter/common/dense.h"

#include <Eigen/Cholesky>
#include <Eigen/SparseCore>
#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "fitter/common/parallel.h"

extern "C" {
void dpotrf_(const char* part, const int* size, double* matrix, const int* stride, int* info);
void dtrtri_(const char* part, const char* unit, const int* size, double* matrix, const int* stride,
             int* info);
void dlauum_(const char* part, const int* size, double* matrix, const int* stride, int* info);
void dsyevd_(const char* vectors, const char* part, const int* size, double* matrix,
             const int* stride, double* values, double* work, const int* work_size,
             int* integer_work, const int* integer_work_size, int* info);
void dgelsy_(const int* rows, const int* columns, const int* right_sides, double* a,
             const int* stride_a, double* b, const int* stride_b, int* order,
             const double* least_share, int* rank, double* work, const int* work_size, int* info);
void dgemm_(const char* turn_a, const char* turn_b, const int* rows, const int* columns,
            const int* depth, const double* alpha, const double* a, const int* stride_a,
            const double* b, const int* stride_b, const double* beta, double* c,
            const int* stride_c);
void dgemv_(const char* turn, const int* rows, const int* columns, const double* alpha,
            const double* a, const int* stride_a, const double* x, const int* step_x,
            const double* beta, double* y, const int* step_y);
void dsyrk_(const char* part, const char* turn, const int* size, const int* depth,
            const double* alpha, const double* a, const int* stride_a, const double* beta,
            double* c, const int* stride_c);
void dtrsm_(const char* side, const char* part, const char* turn, const char* unit, const int* rows,
            const int* columns, const double* alpha, const double* a, const int* stride_a,
            double* b, const int* stride_b);
void dtpqrt_(const int* rows, const int* size, const int* trapezoid, const int* block, double* a,
             const int* stride_a, double* b, const int* stride_b, double* t, const int* stride_t,
             double* work, int* info);
void dtpmqrt_(const char* side, const char* turn, const int* rows, const int* columns,
              const int* size, const int* trapezoid, const int* block, const double* v,
              const int* stride_v, const double* t, const int* stride_t, double* a,
              const int* stride_a, double* b, const int* stride_b, double* work, int* info);
// Null if the BLAS is not OpenBLAS.
__attribute__((weak)) void openblas_set_num_threads(int threads);
}

namespace armtrue {
namespace {

// Fits already run in parallel (parallel.h); additional threads of the BLAS would slow them down.
void be_single_threaded() {
  static const bool done = [] {
    if (openblas_set_num_threads) openblas_set_num_threads(1);
    return true;
  }();
  static_cast<void>(done);
}

// Products with at least this many multiplications are divided into panels, one thread each.
constexpr double kWorthThreads = 2e7;
constexpr Eigen::Index kNarrowestPanel = 64, kPanels = 8;
// In aᵀb with at most kSkinny columns in a, dgemm spends most of its time on reordering b. Such
// products use dgemv on panels of kInCache values of b, which stay in a processor's cache.
constexpr Eigen::Index kSkinny = 8, kInCache = 32768;
// Smaller matrices are factorised in one piece, others in blocks of columns.
constexpr Eigen::Index kSmallFactor = 600, kFactorBlock = 192;
// Up to this size Eigen solves and factorises: calling BLAS or LAPACK takes longer than the
// arithmetic.
constexpr Eigen::Index kSmallest = 16;
// Householder reflectors that LAPACK applies as one product.
constexpr Eigen::Index kReflectorsTogether = 32;
// Products of more multiplications than this treat columns that are mostly zero (those of a table's
// nodes) separately: columns with at most this share of nonzero values.
constexpr double kWorthLooking = 1e9, kMostlyZero = 0.1;

// Calls job(first, count) for panels of `columns` columns, in parallel if the work is large enough.
template <typename Job>
void in_panels(Eigen::Index columns, double multiplications, const Job& job) {
  be_single_threaded();
  if (multiplications < kWorthThreads) {
    if (columns > 0) job(Eigen::Index{0}, columns);
    return;
  }
  const Eigen::Index panel = std::max(kNarrowestPanel, (columns + kPanels - 1) / kPanels);
  in_pieces(columns, panel, [&](Eigen::Index first, Eigen::Index end) { job(first, end - first); });
}

// c ← op(a) op(b), `depth` the length of the sums.
void multiply(const char* turn_a, const char* turn_b, const double* a, Eigen::Index stride_a,
              const double* b, Eigen::Index stride_b, Eigen::Index depth,
              Eigen::Ref<Eigen::MatrixXd> c) {
  const int rows = static_cast<int>(c.rows()), columns = static_cast<int>(c.cols());
  const int k = static_cast<int>(depth), sa = static_cast<int>(stride_a);
  const int sb = static_cast<int>(stride_b), sc = static_cast<int>(c.outerStride());
  const double one = 1.0, zero = 0.0;
  if (rows > 0 && columns > 0)
    dgemm_(turn_a, turn_b, &rows, &columns, &k, &one, a, &sa, b, &sb, &zero, c.data(), &sc);
}

// op(a) b, with `rows` rows.
Eigen::MatrixXd product(const char* turn, const Eigen::Ref<const Eigen::MatrixXd>& a,
                        const Eigen::Ref<const Eigen::MatrixXd>& b, Eigen::Index rows) {
  if (b.rows() == 0) return Eigen::MatrixXd::Zero(rows, b.cols());
  Eigen::MatrixXd result(rows, b.cols());
  const double work = static_cast<double>(result.size()) * static_cast<double>(b.rows());
  in_panels(b.cols(), work, [&](Eigen::Index first, Eigen::Index count) {
    multiply(turn, "N", a.data(), a.outerStride(), b.data() + first * b.outerStride(),
             b.outerStride(), b.rows(), result.middleCols(first, count));
  });
  return result;
}

// Fills the upper triangle of a symmetric matrix from the lower one.
void mirror(Eigen::MatrixXd& lower) {
  lower.triangularView<Eigen::StrictlyUpper>() = lower.transpose();
}

// aᵀa where `turn` is "T", aaᵀ where it is "N".
Eigen::MatrixXd symmetric_product(const char* turn, const Eigen::Ref<const Eigen::MatrixXd>& a,
                                  Eigen::Index size, Eigen::Index depth) {
  if (depth == 0) return Eigen::MatrixXd::Zero(size, size);
  Eigen::MatrixXd result(size, size);
  const Eigen::Index stride = a.outerStride();
  const bool across = *turn == 'N';
  const auto from = [&](Eigen::Index at) { return a.data() + at * (across ? 1 : stride); };
  const double work =
      0.5 * static_cast<double>(size) * static_cast<double>(size) * static_cast<double>(depth);
  in_panels(size, work, [&](Eigen::Index first, Eigen::Index count) {
    const int n = static_cast<int>(count), k = static_cast<int>(depth);
    const int sa = static_cast<int>(stride), sc = static_cast<int>(size);
    const double one = 1.0, zero = 0.0;
    dsyrk_("L", turn, &n, &k, &one, from(first), &sa, &zero, &result(first, first), &sc);
    const Eigen::Index below = first + count;
    if (below == size) return;
    multiply(across ? "N" : "T", across ? "T" : "N", from(below), stride, from(first), stride,
             depth, result.block(below, first, size - below, count));
  });
  mirror(result);
  return result;
}

void solve_triangle(const char* turn, const Eigen::Ref<const Eigen::MatrixXd>& factor,
                    Eigen::Ref<Eigen::MatrixXd> right) {
  if (right.size() == 0) return;
  if (right.rows() <= kSmallest) {
    const auto lower = factor.triangularView<Eigen::Lower>();
    if (*turn == 'N') {
      lower.solveInPlace(right);
    } else {
      lower.transpose().solveInPlace(right);
    }
    return;
  }
  const int rows = static_cast<int>(right.rows());
  const int factor_stride = static_cast<int>(factor.outerStride());
  const int stride = static_cast<int>(right.outerStride());
  const double one = 1.0;
  const double work = 0.5 * static_cast<double>(right.size()) * static_cast<double>(rows);
  in_panels(right.cols(), work, [&](Eigen::Index first, Eigen::Index count) {
    const int columns = static_cast<int>(count);
    dtrsm_("L", "L", turn, "N", &rows, &columns, &one, factor.data(), &factor_stride,
           right.data() + first * right.outerStride(), &stride);
  });
}

// The number of nonzero values in each column of `a`.
std::vector<Eigen::Index> values_by_column(const Eigen::Ref<const Eigen::MatrixXd>& a) {
  std::vector<Eigen::Index> result(static_cast<std::size_t>(a.cols()));
  in_pieces(a.cols(), kNarrowestPanel, [&](Eigen::Index first, Eigen::Index end) {
    for (Eigen::Index c = first; c < end; ++c)
      result[static_cast<std::size_t>(c)] = (a.col(c).array() != 0.0).count();
  });
  return result;
}

// aᵀa, with the columns listed in `sparse` multiplied as a sparse matrix.
Eigen::MatrixXd square_of_parts(const Eigen::Ref<const Eigen::MatrixXd>& a,
                                const std::vector<Eigen::Index>& sparse,
                                const std::vector<Eigen::Index>& dense) {
  const Eigen::SparseMatrix<double> values = a(Eigen::all, sparse).sparseView();
  const Eigen::MatrixXd others = a(Eigen::all, dense);
  Eigen::MatrixXd across(values.cols(), others.cols());
  in_panels(others.cols(), kWorthThreads, [&](Eigen::Index first, Eigen::Index count) {
    across.middleCols(first, count).noalias() =
        values.transpose() * others.middleCols(first, count);
  });
  Eigen::MatrixXd result(a.cols(), a.cols());
  result(sparse, sparse) = Eigen::MatrixXd(values.transpose() * values);
  result(sparse, dense) = across;
  result(dense, sparse) = across.transpose();
  result(dense, dense) = symmetric_product("T", others, others.cols(), others.rows());
  return result;
}

}  // namespace

Eigen::MatrixXd square(const Eigen::Ref<const Eigen::MatrixXd>& a) {
  const auto rows = static_cast<double>(a.rows()), columns = static_cast<double>(a.cols());
  if (0.5 * rows * columns * columns > kWorthLooking) {
    const std::vector<Eigen::Index> values = values_by_column(a);
    std::vector<Eigen::Index> sparse, dense;
    for (Eigen::Index c = 0; c < a.cols(); ++c) {
      const double share = static_cast<double>(values[static_cast<std::size_t>(c)]) / rows;
      (share <= kMostlyZero ? sparse : dense).push_back(c);
    }
    if (sparse.size() > dense.size()) return square_of_parts(a, sparse, dense);
  }
  return symmetric_product("T", a, a.cols(), a.rows());
}

Eigen::MatrixXd square_across(const Eigen::Ref<const Eigen::MatrixXd>& a) {
  return symmetric_product("N", a, a.rows(), a.cols());
}

void solve_lower(const Eigen::Ref<const Eigen::MatrixXd>& factor,
                 Eigen::Ref<Eigen::MatrixXd> right) {
  solve_triangle("N", factor, right);
}

void solve_lower_transposed(const Eigen::Ref<const Eigen::MatrixXd>& factor,
                            Eigen::Ref<Eigen::MatrixXd> right) {
  solve_triangle("T", factor, right);
}

bool factorise_cholesky(Eigen::MatrixXd& lower) {
  if (lower.rows() <= kSmallest)
    return Eigen::LLT<Eigen::Ref<Eigen::MatrixXd>>(lower).info() == Eigen::Success;
  be_single_threaded();
  const Eigen::Index whole = lower.rows();
  const int stride = static_cast<int>(whole);
  const Eigen::Index width = whole < kSmallFactor ? std::max<Eigen::Index>(whole, 1) : kFactorBlock;
  for (Eigen::Index first = 0; first < whole; first += width) {
    const Eigen::Index count = std::min(width, whole - first), below = first + count;
    const int size = static_cast<int>(count);
    int info = 0;
    dpotrf_("L", &size, &lower(first, first), &stride, &info);
    if (info != 0) return false;
    if (below == whole) break;
    const double one = 1.0, less = -1.0;
    const double work = static_cast<double>(whole - below) * static_cast<double>(count * count);
    in_panels(whole - below, work, [&](Eigen::Index panel, Eigen::Index rows) {
      const int n = static_cast<int>(rows);
      dtrsm_("R", "L", "T", "N", &n, &size, &one, &lower(first, first), &stride,
             &lower(below + panel, first), &stride);
    });
    const double update = 0.5 * static_cast<double>(whole - below) *
                          static_cast<double>(whole - below) * static_cast<double>(count);
    in_panels(whole - below, update, [&](Eigen::Index panel, Eigen::Index columns) {
      const Eigen::Index at = below + panel, rest = whole - at - columns;
      const int n = static_cast<int>(columns), m = static_cast<int>(rest);
      dsyrk_("L", "N", &n, &size, &less, &lower(at, first), &stride, &one, &lower(at, at), &stride);
      if (rest > 0)
        dgemm_("N", "T", &m, &n, &size, &less, &lower(at + columns, first), &stride,
               &lower(at, first), &stride, &one, &lower(at + columns, at), &stride);
    });
  }
  return true;
}

Eigen::VectorXd Cholesky::solve(const Eigen::VectorXd& right) const { return solve_matrix(right); }

Eigen::MatrixXd Cholesky::solve_matrix(Eigen::MatrixXd right) const {
  solve_lower(factor_, right);
  solve_lower_transposed(factor_, right);
  return right;
}

Eigen::MatrixXd Cholesky::half_solve(Eigen::MatrixXd right) const {
  solve_lower(factor_, right);
  return right;
}

Eigen::MatrixXd inverse_of_triangle(const Eigen::MatrixXd& lower) {
  be_single_threaded();
  const Eigen::Index size = lower.rows();
  const int stride = static_cast<int>(size);
  if (size == 0) return lower;
  if (size < kSmallFactor) {
    Eigen::MatrixXd inverse = lower;
    int info = 0;
    dtrtri_("L", "N", &stride, inverse.data(), &stride, &info);
    return inverse;
  }
  const double one = 1.0;
  Eigen::MatrixXd inverse = Eigen::MatrixXd::Zero(size, size);
  in_pieces(size, kFactorBlock, [&](Eigen::Index first, Eigen::Index end) {
    const int rows = static_cast<int>(size - first), columns = static_cast<int>(end - first);
    inverse.diagonal().segment(first, end - first).setOnes();
    dtrsm_("L", "L", "N", "N", &rows, &columns, &one, &lower(first, first), &stride,
           &inverse(first, first), &stride);
  });
  return inverse;
}

// A column of a lower triangle is zero above its diagonal, so the product of two columns sums from
// the diagonal of the later one on.
Eigen::MatrixXd square_of_triangle(Eigen::MatrixXd lower) {
  be_single_threaded();
  const Eigen::Index size = lower.rows();
  const int stride = static_cast<int>(size);
  if (size == 0) return lower;
  if (size < kSmallFactor) {
    int info = 0;
    dlauum_("L", &stride, lower.data(), &stride, &info);
    mirror(lower);
    return lower;
  }
  lower.triangularView<Eigen::StrictlyUpper>().setZero();
  const double one = 1.0, zero = 0.0;
  Eigen::MatrixXd result(size, size);
  in_pieces(size, kFactorBlock, [&](Eigen::Index first, Eigen::Index end) {
    const int columns = static_cast<int>(end - first);
    for (Eigen::Index at = first; at < size; at += kFactorBlock) {
      const int rows = static_cast<int>(std::min(kFactorBlock, size - at));
      const int depth = static_cast<int>(size - at);
      dgemm_("T", "N", &rows, &columns, &depth, &one, &lower(at, at), &stride, &lower(at, first),
             &stride, &zero, &result(at, first), &stride);
    }
  });
  mirror(result);
  return result;
}

namespace {

// One plane rotation diagonalises a 2 × 2 matrix (Golub and Van Loan, Matrix Computations, 8.5.2).
// A diagnosis needs thousands of these, and LAPACK would allocate workspaces for each.
SymmetricEigen smallest_eigen(const Eigen::MatrixXd& lower) {
  if (lower.rows() == 1) return {lower.diagonal(), Eigen::MatrixXd::Ones(1, 1)};
  const double first = lower(0, 0), beside = lower(1, 0), second = lower(1, 1);
  double tangent = 0.0;
  if (beside != 0.0) {
    const double half = (second - first) / (2.0 * beside);
    tangent = (half >= 0.0 ? 1.0 : -1.0) / (std::abs(half) + std::hypot(1.0, half));
  }
  const double cosine = 1.0 / std::hypot(1.0, tangent), sine = tangent * cosine;
  SymmetricEigen result{Eigen::Vector2d(first - tangent * beside, second + tangent * beside),
                        Eigen::MatrixXd(2, 2)};
  result.vectors << cosine, sine, -sine, cosine;
  if (result.values[0] > result.values[1]) {
    std::swap(result.values[0], result.values[1]);
    result.vectors.col(0).swap(result.vectors.col(1));
  }
  return result;
}

// Eigenvalues, and the eigenvectors in place of the matrix where `vectors` is "V".
Eigen::VectorXd eigenvalues_in_place(const char* vectors, Eigen::MatrixXd& lower) {
  be_single_threaded();
  const int size = static_cast<int>(lower.rows());
  Eigen::VectorXd values(size);
  if (size == 0) return values;
  // The first call returns the sizes of the workspaces.
  const int ask = -1;
  double work_size = 0.0;
  int integer_size = 0, info = 0;
  dsyevd_(vectors, "L", &size, lower.data(), &size, values.data(), &work_size, &ask, &integer_size,
          &ask, &info);
  std::vector<double> work(static_cast<std::size_t>(work_size));
  std::vector<int> integers(static_cast<std::size_t>(integer_size));
  const int work_count = static_cast<int>(work.size());
  dsyevd_(vectors, "L", &size, lower.data(), &size, values.data(), work.data(), &work_count,
          integers.data(), &integer_size, &info);
  return values;
}

}  // namespace

Eigen::VectorXd symmetric_eigenvalues(Eigen::MatrixXd lower) {
  return eigenvalues_in_place("N", lower);
}

SymmetricEigen symmetric_eigen(Eigen::MatrixXd lower) {
  if (lower.rows() == 1 || lower.rows() == 2) return smallest_eigen(lower);
  SymmetricEigen result;
  result.values = eigenvalues_in_place("V", lower);
  result.vectors = std::move(lower);
  return result;
}

Eigen::MatrixXd least_squares(Eigen::MatrixXd columns, const Eigen::MatrixXd& values,
                              double least_share) {
  be_single_threaded();
  const int rows = static_cast<int>(columns.rows()), size = static_cast<int>(columns.cols());
  const int sides = static_cast<int>(values.cols()), stride = std::max(rows, size);
  Eigen::MatrixXd x = Eigen::MatrixXd::Zero(stride, sides);
  if (columns.size() == 0 || sides == 0) return x.topRows(size);
  x.topRows(rows) = values;
  std::vector<int> order(static_cast<std::size_t>(size), 0);
  int rank = 0, info = 0, work_size = -1;
  double wanted = 0.0;
  std::vector<double> work;
  const auto call = [&](double* space) {
    dgelsy_(&rows, &size, &sides, columns.data(), &rows, x.data(), &stride, order.data(),
            &least_share, &rank, space, &work_size, &info);
  };
  call(&wanted);
  work_size = static_cast<int>(wanted);
  work.resize(static_cast<std::size_t>(work_size));
  call(work.data());
  return x.topRows(size);
}

Eigen::MatrixXd times(const Eigen::Ref<const Eigen::MatrixXd>& a,
                      const Eigen::Ref<const Eigen::MatrixXd>& b) {
  return product("N", a, b, a.rows());
}

Eigen::MatrixXd transpose_times(const Eigen::Ref<const Eigen::MatrixXd>& a,
                                const Eigen::Ref<const Eigen::MatrixXd>& b) {
  if (a.cols() > kSkinny || b.size() < kInCache) return product("T", a, b, a.cols());
  be_single_threaded();
  Eigen::MatrixXd result(a.cols(), b.cols());
  const Eigen::Index panel = std::max<Eigen::Index>(1, kInCache / b.rows());
  const int depth = static_cast<int>(b.rows()), stride = static_cast<int>(b.outerStride());
  const int one_step = 1, step = static_cast<int>(a.cols());
  const double one = 1.0, zero = 0.0;
  for (Eigen::Index first = 0; first < b.cols(); first += panel) {
    const int count = static_cast<int>(std::min(panel, b.cols() - first));
    for (Eigen::Index j = 0; j < a.cols(); ++j) {
      dgemv_("T", &depth, &count, &one, b.data() + first * b.outerStride(), &stride,
             a.data() + j * a.outerStride(), &one_step, &zero, &result(j, first), &step);
    }
  }
  return result;
}

Eigen::MatrixXd congruent(const Eigen::MatrixXd& a, const Eigen::MatrixXd& by) {
  if (by.rows() <= kSmallest) return by.transpose() * a * by;
  return times(transpose_times(by, a), by);
}

GrownFactor::GrownFactor(const Eigen::Ref<const Eigen::MatrixXd>& root,
                         const Eigen::Ref<const Eigen::MatrixXd>& part)
    : factor_(root.triangularView<Eigen::Lower>().transpose()),
      reflectors_(part.transpose()),
      triangles_(std::min(kReflectorsTogether, root.rows()), root.rows()) {
  be_single_threaded();
  const int rows = static_cast<int>(part.cols()), size = static_cast<int>(root.rows()), none = 0;
  const int block = static_cast<int>(triangles_.rows());
  std::vector<double> work(static_cast<std::size_t>(triangles_.size()));
  int info = 0;
  if (rows > 0 && size > 0)
    dtpqrt_(&rows, &size, &none, &block, factor_.data(), &size, reflectors_.data(), &rows,
            triangles_.data(), &block, work.data(), &info);
  // The sign of each row is free; a Cholesky factor has a positive diagonal.
  sign_ = factor_.diagonal().unaryExpr([](double d) { return d < 0.0 ? -1.0 : 1.0; });
  const Eigen::MatrixXd upper = sign_.asDiagonal() * factor_;
  factor_ = upper.triangularView<Eigen::Upper>().transpose();
}

void GrownFactor::turn(Eigen::Ref<Eigen::MatrixXd> a, Eigen::Ref<Eigen::MatrixXd> b) const {
  const int rows = static_cast<int>(reflectors_.rows()), size = static_cast<int>(factor_.rows());
  const int none = 0, block = static_cast<int>(triangles_.rows());
  if (rows == 0 || size == 0) return;
  const int stride_a = static_cast<int>(a.outerStride()),
            stride_b = static_cast<int>(b.outerStride());
  const double work = 2.0 * static_cast<double>(a.size()) * static_cast<double>(rows);
  in_panels(a.cols(), work, [&](Eigen::Index first, Eigen::Index count) {
    const int columns = static_cast<int>(count);
    std::vector<double> space(static_cast<std::size_t>(triangles_.rows() * count));
    int info = 0;
    dtpmqrt_("L", "T", &rows, &columns, &size, &none, &block, reflectors_.data(), &rows,
             triangles_.data(), &block, &a(0, first), &stride_a, &b(0, first), &stride_b,
             space.data(), &info);
    for (Eigen::Index c = first; c < first + count; ++c) a.col(c).array() *= sign_.array();
  });
}

}  // namespace armtrue
