// Rows that are no measurements of the pose beside which they stand: bumped reflectors, lost
// readings.
#pragma once

#include <vector>

namespace armtrue {

/// The median of the length of three normal errors, in their sigma: of chi with three degrees of
/// freedom.
inline constexpr double kMedianChi3 = 1.5381722;

/// The distance [m] between measured and predicted point from which a row is a gross error, among
/// such distances of all rows. `reach`: the arm's [m].
double gross_limit(const std::vector<double>& distance, double reach);

}  // namespace armtrue
