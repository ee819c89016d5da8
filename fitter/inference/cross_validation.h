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

/// Fold number (0…folds−1) of every row. Depends on the poses and the seed, not on the order of the
/// rows (but for kTime if no time is recorded).
std::vector<int> make_folds(const Design& design, Folding folding, int folds, std::uint64_t seed);

/// Held-out distance [m] between measured and predicted position of every row, predicted by the fit
/// without the row's fold; one vector for each of `foldings` (fold numbers of every row). NaN: rows
/// without weight, and rows with an unknown that no other fold measures.
///
/// Each of these fits is one exact Gauss–Newton step from the full solution, with the fold's part
/// subtracted from JᵀJ and Jᵀr. The model is nearly linear in its parameters, so the difference
/// from refitting is far below the held-out errors. The unknowns `unforeseen` are fitted, so that
/// no other takes their place, and count as zero in the prediction.
std::vector<std::vector<double>> held_out_distances(
    const Design& design, const EvaluatedRows& evaluated,
    const std::vector<std::vector<int>>& foldings, int folds, double smoothness_sigma,
    const std::vector<Eigen::Index>& unforeseen = {});

/// Errors on poses that were held out at random, in blocks of time, and by region, in this order.
/// Those at random are averages over several splits if there are few poses.
struct CrossValidation {
  std::vector<ErrorSummary> errors = std::vector<ErrorSummary>(3);
  /// [m] by row, as held_out_distances() returns them.
  std::vector<std::vector<double>> distances = std::vector<std::vector<double>>(3);
};
CrossValidation cross_validate(const Design& design, const EvaluatedRows& evaluated, int folds,
                               std::uint64_t seed, double smoothness_sigma,
                               const std::vector<Eigen::Index>& unforeseen = {});

/// Distance [m] between measured and predicted position of every row, at the design's present
/// values.
std::vector<double> residual_distances(Design& design);

/// Summary of the finite distances.
ErrorSummary summarise_finite(const std::vector<double>& distances);

}  // namespace armtrue
