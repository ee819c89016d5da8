// Dense linear algebra by the machine's BLAS and LAPACK. Eigen is compiled for any x86-64; a BLAS
// tuned to the processor (Debian: OpenBLAS) is several times faster from a hundred unknowns on.
// -march is no alternative: it is not compatible with Ceres' copies of Eigen's templates.
#pragma once

#include <Eigen/Core>
#include <utility>

namespace armtrue {

/// Replaces the lower triangle of a symmetric matrix by its Cholesky factor; only this triangle is
/// read and written (LAPACK dpotrf). False if the matrix is not positive definite; it then holds no
/// factor.
bool factorise_cholesky(Eigen::MatrixXd& lower);

/// L⁻¹ of a lower triangle L; elements above its diagonal are undefined (LAPACK dtrtri).
Eigen::MatrixXd inverse_of_triangle(const Eigen::MatrixXd& lower);

/// LᵀL of a lower triangle L, both triangles (LAPACK dlauum).
Eigen::MatrixXd square_of_triangle(Eigen::MatrixXd lower);

/// A symmetric positive definite matrix A = L Lᵀ, to solve A x = b (LAPACK dpotrf).
class Cholesky {
 public:
  /// `lower`: A, of which the lower triangle is read.
  explicit Cholesky(Eigen::MatrixXd lower)
      : factor_(std::move(lower)), ok_(factorise_cholesky(factor_)) {}
  /// False if the matrix is not positive definite; the other members are then undefined.
  bool ok() const { return ok_; }
  /// L; elements above its diagonal are undefined.
  const Eigen::MatrixXd& lower() const { return factor_; }
  /// A⁻¹ right.
  Eigen::VectorXd solve(const Eigen::VectorXd& right) const;
  Eigen::MatrixXd solve_matrix(Eigen::MatrixXd right) const;
  /// L⁻¹ right.
  Eigen::MatrixXd half_solve(Eigen::MatrixXd right) const;

 private:
  Eigen::MatrixXd factor_;
  bool ok_;
};

/// Eigenvalues of a symmetric matrix of which the lower triangle is read, ascending (LAPACK
/// dsyevd).
Eigen::VectorXd symmetric_eigenvalues(Eigen::MatrixXd lower);

/// The same with eigenvectors as columns.
struct SymmetricEigen {
  Eigen::VectorXd values;
  Eigen::MatrixXd vectors;
};
SymmetricEigen symmetric_eigen(Eigen::MatrixXd lower);

/// Least-squares solution x of columns · x = values, for each column of `values`. If columns are
/// linearly dependent, the solution of least norm; `least_share` is the reciprocal condition number
/// below which they count as dependent (LAPACK dgelsy).
Eigen::MatrixXd least_squares(Eigen::MatrixXd columns, const Eigen::MatrixXd& values,
                              double least_share = 1e-14);

/// aᵀ a, both triangles (BLAS dsyrk). If `a` is large and most of its columns hold few nonzero
/// values, these columns are multiplied as a sparse matrix.
Eigen::MatrixXd square(const Eigen::Ref<const Eigen::MatrixXd>& a);

/// a aᵀ, both triangles (BLAS dsyrk).
Eigen::MatrixXd square_across(const Eigen::Ref<const Eigen::MatrixXd>& a);

/// right ← L⁻¹ right, or L⁻ᵀ right, of a factor's lower triangle (BLAS dtrsm).
void solve_lower(const Eigen::Ref<const Eigen::MatrixXd>& factor,
                 Eigen::Ref<Eigen::MatrixXd> right);
void solve_lower_transposed(const Eigen::Ref<const Eigen::MatrixXd>& factor,
                            Eigen::Ref<Eigen::MatrixXd> right);

/// a b, and aᵀ b (BLAS dgemm).
Eigen::MatrixXd times(const Eigen::Ref<const Eigen::MatrixXd>& a,
                      const Eigen::Ref<const Eigen::MatrixXd>& b);
Eigen::MatrixXd transpose_times(const Eigen::Ref<const Eigen::MatrixXd>& a,
                                const Eigen::Ref<const Eigen::MatrixXd>& b);

/// byᵀ a by.
Eigen::MatrixXd congruent(const Eigen::MatrixXd& a, const Eigen::MatrixXd& by);

/// The factor L′ of L Lᵀ + S Sᵀ (LAPACK dtpqrt), and the transformation from L to L′.
class GrownFactor {
 public:
  /// `root`: L, lower triangle read; `part`: S.
  GrownFactor(const Eigen::Ref<const Eigen::MatrixXd>& root,
              const Eigen::Ref<const Eigen::MatrixXd>& part);
  /// Lower triangle, zeros above.
  const Eigen::MatrixXd& factor() const { return factor_; }
  /// a ← L′⁻¹ (L a + S b); the contents of b are undefined afterwards.
  void turn(Eigen::Ref<Eigen::MatrixXd> a, Eigen::Ref<Eigen::MatrixXd> b) const;

 private:
  Eigen::MatrixXd factor_, reflectors_, triangles_;
  Eigen::VectorXd sign_;
};

}  // namespace armtrue
