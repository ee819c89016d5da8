// Bindings of the catalogue of effects.
#pragma once

#include <nanobind/nanobind.h>

namespace armtrue {

/// Adds effects and effect_terms to the module.
void bind_catalogue(nanobind::module_& m);

}  // namespace armtrue
