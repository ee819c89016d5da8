// Bindings of the data for plots of a fit.
#pragma once

#include <nanobind/nanobind.h>

namespace armtrue {

/// Adds state_column and coordinate_column to the module.
void bind_drawing(nanobind::module_& m);

}  // namespace armtrue
