// Gross errors: rows that do not measure the pose beside which they are listed (bumped reflectors,
// lost readings).
#pragma once

#include <vector>

namespace armtrue {

/// Median of the chi distribution with three degrees of freedom: of the length of three normal
/// errors, in units of their sigma.
inline constexpr double kMedianChi3 = 1.5381722;

/// Limit [m] on the distance between measured and predicted point: a row beyond it is a gross
/// error. `distance`: these distances of the rows [m]; `reach`: the arm's [m].
double gross_limit(const std::vector<double>& distance, double reach);

}  // namespace armtrue
