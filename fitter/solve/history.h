// Errors of predictions that know a row alone. Some effects depend on the arm's past (the warmth of
// a gear): a fit knows it from the rows before, a prediction assumes its average.
#pragma once

#include "fitter/inference/cross_validation.h"

namespace armtrue {

/// Parameters, and unknowns of a design, that no prediction contains (is_foreseeable).
struct Unforeseen {
  std::vector<int> parameters;
  std::vector<Eigen::Index> unknowns;
};
Unforeseen unforeseen_in(const Design& design);

/// Distance [m] between measured and predicted position of every row, at the design's present
/// values with the unforeseen parameters at zero.
std::vector<double> distances_without(const Unforeseen& unforeseen, Design& design);

}  // namespace armtrue
