// Repeats of one pose share the arm's error in that pose, which must count once only.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "fitter/model/measurements.h"

namespace armtrue {

/// Rows that measure the same pose and reflector again. Their errors are assumed to have one common
/// correlation (compound symmetry; Searle, Casella and McCulloch 1992, Variance Components, ch. 3):
/// 0 where the arm approached the pose anew for each reading, near 1 where one visit was measured
/// often, and in between where a missing effect adds to both.
class Replicates {
 public:
  /// Of all rows.
  explicit Replicates(const Measurements& measurements);
  /// `rows`: those in use, in order. In the other functions, a place is an index into `rows`.
  Replicates(const Measurements& measurements, const std::vector<std::size_t>& rows);

  bool any() const { return !groups_.empty(); }
  /// Places of each group, two or more.
  const std::vector<std::vector<Eigen::Index>>& groups() const { return groups_; }
  /// Group of every place; −1 where it was not repeated.
  const std::vector<int>& group_of() const { return group_of_; }

  /// Maximum-likelihood correlation of residuals with mean zero, `height` values a place.
  double correlation(const Eigen::VectorXd& residual, int height) const;
  /// Independent measurements that each place counts as (Kish 1965, Survey Sampling, sec. 5.4: the
  /// inverse of the design effect): 1 where it was not repeated.
  std::vector<double> worth(double correlation) const;
  /// log |correlation matrix| over all places, for one value a place.
  double log_determinant(double correlation) const;
  /// Whitens columns (`height` values a place) for ordinary least squares: equal variances, no
  /// correlation (quasi-demeaning).
  void whiten(Eigen::Ref<Eigen::MatrixXd> columns, int height, double correlation) const;

 private:
  std::vector<std::vector<Eigen::Index>> groups_;
  std::vector<int> group_of_;
};

}  // namespace armtrue
