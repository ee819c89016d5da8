// Loads deflect the arm, and the deflected arm changes its loads: first-order feedback by row.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "fitter/design/model.h"

namespace armtrue {

/// Springs whose loads change with the coordinates. Without `update` there is no feedback.
class LoadFeedback {
 public:
  LoadFeedback(const Model& model, const CoordinateLayout& layout, const State& state);

  /// Computes gradients and slopes at the present loads of the state. `columns`: what terms read;
  /// `frames`: rows × (n + 1), as in State::stand; `coordinates`: rows × layout.size(), of the
  /// arm's own parameters.
  void update(const State& state, const Expression::Columns& columns,
              const std::vector<Pose>& frames, std::vector<double> coordinates);
  /// Loads stay constant from now on.
  void clear() { at_.clear(); }
  bool stands() const { return !at_.empty(); }
  /// Adds the deflection by load changes since `update`; `arm`: the arm's own coordinates now.
  void correct(std::size_t row, const std::vector<double>& values, const Eigen::VectorXd& arm,
               Eigen::VectorXd& coordinates) const;
  /// Adds to each column of a Jacobian by the coordinates the deflection by the loads that follow.
  void follow(std::size_t row, const std::vector<double>& values,
              Eigen::Matrix<double, 6, Eigen::Dynamic>& jacobian) const;

 private:
  struct Spring {
    std::size_t parameter, load;
    int coordinate;
    double weight;
    Expression basis = Expression::number(0.0);
    std::vector<double> slope;  // of the basis by the load, by row
  };
  using Gradients =
      Eigen::Map<const Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>>;
  Gradients gradients(std::size_t row) const;

  CoordinateLayout layout_;
  std::vector<Variable> loads_;
  std::vector<Spring> springs_;
  std::vector<double> at_, gradient_;
};

}  // namespace armtrue
