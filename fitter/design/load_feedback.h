// Loads bend the arm, and the bent arm changes its loads: the first order of that, row by row.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "fitter/design/model.h"

namespace armtrue {

/// Springs whose loads change with the coordinates. Without `update` there is no feedback.
class LoadFeedback {
 public:
  LoadFeedback(const Model& model, const CoordinateLayout& layout, const State& state);

  /// Takes gradients and slopes where the state's loads stand now. `columns`: what terms read;
  /// `frames`: rows × (n + 1), as State::stand has them; `coordinates`: rows × layout.size(), of
  /// what belongs to the arm.
  void update(const State& state, const Expression::Columns& columns,
              const std::vector<Pose>& frames, std::vector<double> coordinates);
  /// Loads do not follow from now on.
  void clear() { at_.clear(); }
  bool stands() const { return !at_.empty(); }
  /// Adds what loads change by since `update`, `arm` being the arm's own coordinates now.
  void correct(std::size_t row, const std::vector<double>& values, const Eigen::VectorXd& arm,
               Eigen::VectorXd& coordinates) const;
  /// Turns a Jacobian by the coordinates into one by causes of them: what they move the arm by with
  /// the loads that follow.
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
