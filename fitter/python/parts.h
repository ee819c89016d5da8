// The parts of armtrue._core beside fits themselves.
#pragma once

#include <nanobind/nanobind.h>

namespace armtrue {

/// Adds effects and effect_terms to the module.
void bind_catalogue(nanobind::module_& m);
/// Adds state_column, coordinate_column and residuals_in_noise, after Fit has been bound.
void bind_drawing(nanobind::module_& m);
/// Adds plan_campaign, plan_sharpening, plan_evidence and plan_separation, after Fit has been
/// bound.
void bind_plan(nanobind::module_& m);

}  // namespace armtrue
