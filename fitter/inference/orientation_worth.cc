#include "fitter/inference/orientation_worth.h"

namespace armtrue {
namespace {

constexpr int kFolds = 4;
constexpr double kStep = 2.0, kLargest = 32.0;
// A smaller weight must reduce the held-out error below this share of the least one so far: a
// smaller gain may be chance.
constexpr double kWorthIt = 0.995;

}  // namespace

double orientation_inflation(const Design& design, const EvaluatedRows& evaluated,
                             double smoothness_sigma, std::uint64_t seed) {
  const std::vector<std::vector<int>> folds{make_folds(design, Folding::kRandom, kFolds, seed)};
  const auto held_out = [&](const EvaluatedRows& rows) {
    return summarise_finite(held_out_distances(design, rows, folds, kFolds, smoothness_sigma)[0])
        .mean;
  };
  EvaluatedRows weighed = evaluated;
  double least = held_out(weighed), best = 1.0;
  for (double factor = kStep; factor <= kLargest; factor *= kStep) {
    for (Design::Row& row : weighed.rows) {
      row.residual.tail<3>() /= kStep;
      row.jacobian.bottomRows<3>() /= kStep;
    }
    const double error = held_out(weighed);
    if (!(error < kWorthIt * least)) break;
    least = error;
    best = factor;
  }
  return best;
}

}  // namespace armtrue
