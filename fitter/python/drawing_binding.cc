#include "fitter/python/drawing_binding.h"

#include <nanobind/stl/string.h>

#include <vector>

#include "fitter/python/arrays.h"
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

}  // namespace

void bind_drawing(nb::module_& m) {
  m.def("state_column", &state_column, "fit"_a, "name"_a,
        "A state variable of docs/model.md over the fitted rows, (N, 1).");
  m.def("coordinate_column", &coordinate_column, "fit"_a, "name"_a,
        "Change of every predicted position by one coordinate [m per unit], (N, 3).");
}

}  // namespace armtrue
