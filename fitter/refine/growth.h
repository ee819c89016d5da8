// How held-out errors change from one model of the same measurements to another.
#pragma once

#include <limits>
#include <vector>

#include "fitter/solve/fit.h"

namespace armtrue {

/// By how much held-out errors grow from one model to another.
struct Growth {
  /// Logarithm of the factor, over the foldings (at random, in time, by region); infinite where
  /// nothing can be predicted.
  double mean = std::numeric_limits<double>::infinity();
  /// Standard error of `mean`, estimated from the changes of the single rows.
  double sigma = 0.0;
};

/// Standard error of the sum of changes, estimated from their own sizes, the largest aside: a
/// single pose that one of two models predicts wildly would be its own excuse.
double error_of_sum(const std::vector<double>& changes);

/// Rows count that either model was fitted to: one may explain what the other takes for a gross
/// error. `in_time`: false for what runs with time, which is not judged by predicting times unlike
/// those that it was seen at.
Growth held_out_growth(const Fit& before, const Fit& after, bool in_time);

}  // namespace armtrue
