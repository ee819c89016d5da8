// How far each effect of a fit moves the tool over the campaign.
#pragma once

#include <map>
#include <string>

#include "fitter/design/design.h"

namespace armtrue {

/// Root mean square displacement [m] of the tool by each effect's parameters at their present
/// values, over all rows, with the loads that follow the arm.
std::map<std::string, double> effect_sizes(Design& design);

}  // namespace armtrue
