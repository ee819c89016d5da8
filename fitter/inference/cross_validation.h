// Errors on poses that were not fitted.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "fitter/common/statistics.h"
#include "fitter/design/normal_equations.h"

namespace armtrue {

/// How held-out poses are chosen. Repeats of one pose always stay together.
enum class Folding {
  kRandom,  ///< at random
  kTime,    ///< contiguous blocks in time (temporal cross-validation)
  kRegion   ///< clusters of tool positions
};

/// Fold number (0…folds−1) of every row. Deterministic for a seed.
std::vector<int> make_folds(const Design& design, Folding folding, int folds, std::uint64_t seed);

/// Distance between prediction and measurement [m] of every row with weight, each predicted by the
/// fit without its fold; for each of `foldings` (fold numbers of every row).
///
/// The left-out fits are one exact Gauss–Newton step from the full solution (JᵀJ and Jᵀr less the
/// fold's own): the model is so nearly linear in its parameters that this differs from refitting by
/// far less than the errors it measures. Rows without weight get NaN.
std::vector<std::vector<double>> held_out_distances(const Design& design,
                                                    const EvaluatedRows& evaluated,
                                                    const std::vector<std::vector<int>>& foldings,
                                                    int folds, double smoothness_sigma);

/// Errors on poses that were held out at random, in blocks of time, and by region, in this order.
struct CrossValidation {
  std::vector<ErrorSummary> errors = std::vector<ErrorSummary>(3);
  /// [m] by row: not a number for rows that are kept out of the fit.
  std::vector<std::vector<double>> distances = std::vector<std::vector<double>>(3);
};
CrossValidation cross_validate(const Design& design, const EvaluatedRows& evaluated, int folds,
                               std::uint64_t seed, double smoothness_sigma);

/// Distances [m] of all rows at the design's present values.
std::vector<double> residual_distances(Design& design);

/// Summary of the finite distances.
ErrorSummary summarise_finite(const std::vector<double>& distances);

}  // namespace armtrue
