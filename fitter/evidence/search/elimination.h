// Normal equations in which members are eliminated one after the other.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <vector>

namespace armtrue {

/// Least squares in which sets of columns, the members, are added and removed. Given are G = ZᵀZ
/// and Zᵀy of all columns Z. A member is some of these columns times a factor W of its own; the
/// prior of its coefficients is standard normal. The normal equations of all other columns, with
/// the members eliminated, follow from one triangular factor of I + WᵀGW, which is updated with
/// every member. G is never changed, so rounding errors do not accumulate.
class Elimination {
 public:
  /// Normal equations of some columns with members eliminated.
  struct Local {
    Eigen::MatrixXd gram;
    Eigen::VectorXd gradient;
    double squares = 0.0;  ///< yᵀy less the part that the members explain
  };

  /// Keeps references to both.
  Elimination(const Eigen::MatrixXd& gram, const Eigen::VectorXd& gradient, double squares);

  /// Adds member `key`: columns from `first` on, times `factor`.
  void add(std::size_t key, Eigen::Index first, const Eigen::MatrixXd& factor);
  void remove(std::size_t key);

  /// Normal equations of `width` columns from `first` on, with all members eliminated.
  Local beside(Eigen::Index first, Eigen::Index width) const;
  /// Normal equations of a member's own columns, with all other members eliminated.
  Local without(std::size_t key) const;
  /// The part of the Gram matrix between two ranges of columns, with all members eliminated.
  Eigen::MatrixXd across(Eigen::Index first, Eigen::Index width, Eigen::Index other,
                         Eigen::Index other_width) const;

  double squares() const { return squares_ - along_.head(size_).squaredNorm(); }
  /// log |I + WᵀGW|.
  double log_determinant() const;

 private:
  struct Member {
    std::size_t key;
    Eigen::Index first, size;  // rows of the root
    Eigen::Index column;       // first column in the Gram matrix
    Eigen::MatrixXd factor;
  };
  std::vector<Member>::const_iterator find(std::size_t key) const;
  Local without_exactly(const Member& member) const;
  void reserve(Eigen::Index size);
  void complete(Eigen::Index first, Eigen::Index width) const;

  const Eigen::MatrixXd& gram_;
  const Eigen::VectorXd& gradient_;
  double squares_;
  std::vector<Member> members_;  // in the order of their addition
  Eigen::Index size_ = 0;        // directions of all members
  Eigen::MatrixXd root_;         // L, lower triangle, of I + WᵀGW
  // L⁻¹ WᵀG, a column for each of G's. Of each column only the first rows, as many as `known_`
  // says, are those of the present members; complete() works out the others.
  mutable Eigen::MatrixXd half_;
  mutable std::vector<Eigen::Index> known_;
  Eigen::VectorXd along_;  // L⁻¹ Wᵀ(Zᵀy)
};

}  // namespace armtrue
