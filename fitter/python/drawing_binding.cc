#include <nanobind/stl/string.h>

#include <algorithm>
#include <vector>

#include "fitter/python/arrays.h"
#include "fitter/python/parts.h"
#include "fitter/solve/fit.h"

namespace nb = nanobind;
using namespace nb::literals;

namespace armtrue {
namespace {

Vectors state_column(const Fit& fit, const std::string& name) {
  return to_numpy(fit.state().column(name), 1);
}

Vectors coordinate_column(Fit& fit, const std::string& name) {
  const CoordinateLayout& layout = fit.kinematics().layout();
  const int index = layout.index(parse_coordinate(name, layout.joints, layout.targets));
  std::vector<double> column;
  Design::Row row;
  for (std::size_t i = 0; i < fit.design().rows(); ++i) {
    fit.design().evaluate(i, true, row);
    for (int axis = 0; axis < 3; ++axis) {
      column.push_back(fit.design().geometric_jacobian()(axis, index));
    }
  }
  return to_numpy(std::move(column), 3);
}

// Rows that a fit keeps out are included: the caller decides their weight.
Vectors residuals_in_noise(Fit& fit, Fit& noise_of) {
  Design& yardstick = noise_of.design();
  const std::vector<double> weights = yardstick.weights();
  std::fill(yardstick.weights().begin(), yardstick.weights().end(), 1.0);
  const int height = yardstick.residuals_per_row();
  std::vector<double> whitened;
  for (std::size_t i = 0; i < fit.design().rows(); ++i) {
    const Pose predicted = fit.design().predict(i);
    Eigen::Matrix<double, 6, 1> left = Eigen::Matrix<double, 6, 1>::Zero();
    left.head<3>() =
        fit.measurements().position.col(static_cast<Eigen::Index>(i)) - predicted.translation();
    if (height == 6)
      left.tail<3>() =
          -rotation_log(predicted.linear() * fit.measurements().rotation[i].transpose());
    const Eigen::Matrix<double, 6, 1> row = yardstick.whiten(i, left);
    whitened.insert(whitened.end(), row.data(), row.data() + height);
  }
  yardstick.weights() = weights;
  return to_numpy(std::move(whitened), static_cast<std::size_t>(height));
}

}  // namespace

void bind_drawing(nb::module_& m) {
  m.def("state_column", &state_column, "fit"_a, "name"_a,
        "A state variable of docs/model.md over the fitted rows, (N, 1).");
  m.def("coordinate_column", &coordinate_column, "fit"_a, "name"_a,
        "Change of every predicted position by one coordinate [m per unit], (N, 3).");
  m.def("residuals_in_noise", &residuals_in_noise, "fit"_a, "noise_of"_a,
        "Measured minus predicted position, and turn where orientations were measured, in standard "
        "deviations of another fit to the same rows, (N, 3) or (N, 6).");
}

}  // namespace armtrue
