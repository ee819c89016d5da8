// Change of held-out errors from one model of the same measurements to another.
#pragma once

#include <limits>
#include <vector>

#include "fitter/solve/fit.h"

namespace armtrue {

/// By how much held-out errors grow from one model to another.
struct Growth {
  /// Logarithm of the factor, averaged over the foldings (at random, in time, by region); infinite
  /// if nothing can be predicted.
  double mean = std::numeric_limits<double>::infinity();
  /// Standard error of `mean`, estimated from the changes of the single rows.
  double sigma = 0.0;
};

/// Standard error of the sum of changes, estimated from their own sizes without the largest: else a
/// single wild prediction by one of two models would make its own change look like chance.
double error_of_sum(const std::vector<double>& changes);

/// Counts rows that either model was fitted to: one may explain what the other rejects as a gross
/// error. `in_time`: false for effects of time, which are not judged by predictions for times
/// unlike those that they were fitted at.
Growth held_out_growth(const Fit& before, const Fit& after, bool in_time);

}  // namespace armtrue
