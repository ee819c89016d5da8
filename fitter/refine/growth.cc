#include "fitter/refine/growth.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <vector>

#include "fitter/inference/cross_validation.h"

namespace armtrue {
namespace {

// Errors of predicting each row without having fitted it [m]; not a number where unknown. No fit
// has seen the rows kept out as gross errors.
std::vector<double> unseen_distances(const Fit& fit, std::size_t folding) {
  std::vector<double> distance = fit.held_out_with_history().distances[folding];
  for (const RejectedRow& r : fit.rejected()) distance[r.row] = r.residual;
  return distance;
}

}  // namespace

double error_of_sum(const std::vector<double>& changes) {
  double squares = 0.0, most = 0.0;
  for (const double change : changes) {
    squares += change * change;
    most = std::max(most, change * change);
  }
  return std::sqrt(squares - most);
}

Growth held_out_growth(const Fit& before, const Fit& after, bool in_time) {
  double sum = 0.0, sigmas = 0.0, count = 0.0;
  for (const Folding folding : {Folding::kRandom, Folding::kTime, Folding::kRegion}) {
    if (!in_time && folding == Folding::kTime) continue;
    const auto f = static_cast<std::size_t>(folding);
    const std::vector<double> was = unseen_distances(before, f), is = unseen_distances(after, f);
    double sum_was = 0.0, sum_is = 0.0;
    std::vector<double> changes;
    for (std::size_t i = 0; i < was.size(); ++i) {
      const bool fitted = std::isfinite(before.held_out_with_history().distances[f][i]) ||
                          std::isfinite(after.held_out_with_history().distances[f][i]);
      if (!fitted || !std::isfinite(was[i]) || !std::isfinite(is[i])) continue;
      sum_was += was[i];
      sum_is += is[i];
      changes.push_back(is[i] - was[i]);
    }
    if (!(sum_was > 0.0) || !(sum_is > 0.0)) return {};
    sum += std::log(sum_is / sum_was);
    sigmas += error_of_sum(changes) / sum_was;
    count += 1.0;
  }
  return {sum / count, sigmas / count};
}

}  // namespace armtrue
