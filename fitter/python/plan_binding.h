// The part of armtrue._core that plans measurements.
#pragma once

#include <nanobind/nanobind.h>

namespace armtrue {

/// Adds plan_campaign, plan_sharpening and plan_separation to the module, after Fit has been bound.
void bind_plan(nanobind::module_& module);

}  // namespace armtrue
