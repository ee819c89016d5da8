#include "fitter/solve/dense.h"

#include <utility>
#include <vector>

extern "C" {
void dpotrf_(const char* part, const int* size, double* matrix, const int* stride, int* info);
void dpotri_(const char* part, const int* size, double* matrix, const int* stride, int* info);
void dsyevd_(const char* vectors, const char* part, const int* size, double* matrix,
             const int* stride, double* values, double* work, const int* work_size,
             int* integer_work, const int* integer_work_size, int* info);
void dgemm_(const char* turn_a, const char* turn_b, const int* rows, const int* columns,
            const int* depth, const double* alpha, const double* a, const int* stride_a,
            const double* b, const int* stride_b, const double* beta, double* c,
            const int* stride_c);
void dsyrk_(const char* part, const char* turn, const int* size, const int* depth,
            const double* alpha, const double* a, const int* stride_a, const double* beta,
            double* c, const int* stride_c);
void dtrsm_(const char* side, const char* part, const char* turn, const char* unit, const int* rows,
            const int* columns, const double* alpha, const double* a, const int* stride_a,
            double* b, const int* stride_b);
// Only where the BLAS is OpenBLAS.
__attribute__((weak)) void openblas_set_num_threads(int threads);
}

namespace armtrue {
namespace {

// Fits run side by side already (parallel.h); threads of the BLAS beside them only get in the way.
void be_single_threaded() {
  static const bool done = [] {
    if (openblas_set_num_threads) openblas_set_num_threads(1);
    return true;
  }();
  static_cast<void>(done);
}

Eigen::MatrixXd symmetric_product(const char* turn, const Eigen::Ref<const Eigen::MatrixXd>& a,
                                  Eigen::Index size, Eigen::Index depth) {
  be_single_threaded();
  Eigen::MatrixXd result = Eigen::MatrixXd::Zero(size, size);
  if (size == 0 || depth == 0) return result;
  const int n = static_cast<int>(size), k = static_cast<int>(depth);
  const int stride = static_cast<int>(a.outerStride());
  const double one = 1.0, zero = 0.0;
  dsyrk_("L", turn, &n, &k, &one, a.data(), &stride, &zero, result.data(), &n);
  result.triangularView<Eigen::StrictlyUpper>() = result.transpose();
  return result;
}

void solve_triangle(const char* turn, const Eigen::MatrixXd& factor,
                    Eigen::Ref<Eigen::MatrixXd> right) {
  be_single_threaded();
  if (right.size() == 0) return;
  const int rows = static_cast<int>(right.rows()), columns = static_cast<int>(right.cols());
  const int stride = static_cast<int>(right.outerStride());
  const double one = 1.0;
  dtrsm_("L", "L", turn, "N", &rows, &columns, &one, factor.data(), &rows, right.data(), &stride);
}

}  // namespace

Eigen::MatrixXd square(const Eigen::Ref<const Eigen::MatrixXd>& a) {
  return symmetric_product("T", a, a.cols(), a.rows());
}

Eigen::MatrixXd square_across(const Eigen::Ref<const Eigen::MatrixXd>& a) {
  return symmetric_product("N", a, a.rows(), a.cols());
}

void solve_lower(const Eigen::MatrixXd& factor, Eigen::Ref<Eigen::MatrixXd> right) {
  solve_triangle("N", factor, right);
}

void solve_lower_transposed(const Eigen::MatrixXd& factor, Eigen::Ref<Eigen::MatrixXd> right) {
  solve_triangle("T", factor, right);
}

bool factorise_cholesky(Eigen::MatrixXd& lower) {
  be_single_threaded();
  const int size = static_cast<int>(lower.rows());
  int info = 0;
  if (size > 0) dpotrf_("L", &size, lower.data(), &size, &info);
  return info == 0;
}

void invert_cholesky(Eigen::MatrixXd& lower) {
  be_single_threaded();
  const int size = static_cast<int>(lower.rows());
  int info = 0;
  if (size > 0) dpotri_("L", &size, lower.data(), &size, &info);
}

namespace {

// Eigenvalues, and the eigenvectors in place of the matrix where `vectors` is "V".
Eigen::VectorXd eigenvalues_in_place(const char* vectors, Eigen::MatrixXd& lower) {
  be_single_threaded();
  const int size = static_cast<int>(lower.rows());
  Eigen::VectorXd values(size);
  if (size == 0) return values;
  // LAPACK says how large its workspaces should be.
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
  SymmetricEigen result;
  result.values = eigenvalues_in_place("V", lower);
  result.vectors = std::move(lower);
  return result;
}

Eigen::MatrixXd transpose_times(const Eigen::Ref<const Eigen::MatrixXd>& a,
                                const Eigen::Ref<const Eigen::MatrixXd>& b) {
  be_single_threaded();
  Eigen::MatrixXd result = Eigen::MatrixXd::Zero(a.cols(), b.cols());
  if (result.size() == 0 || a.rows() == 0) return result;
  const int rows = static_cast<int>(a.cols()), columns = static_cast<int>(b.cols());
  const int depth = static_cast<int>(a.rows());
  const int stride_a = static_cast<int>(a.outerStride());
  const int stride_b = static_cast<int>(b.outerStride());
  const double one = 1.0, zero = 0.0;
  dgemm_("T", "N", &rows, &columns, &depth, &one, a.data(), &stride_a, b.data(), &stride_b, &zero,
         result.data(), &rows);
  return result;
}

}  // namespace armtrue
