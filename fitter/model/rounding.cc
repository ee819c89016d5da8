#include "fitter/model/rounding.h"

#include <algorithm>
#include <cmath>
#include <initializer_list>
#include <numbers>

namespace armtrue {
namespace {

// Tolerance for a multiple of a step after a change of units, in steps.
constexpr double kOff = 1e-4;
constexpr double kDegree = std::numbers::pi / 180.0;

bool are_multiples(std::span<const double> values, double step) {
  return !values.empty() && std::ranges::all_of(values, [&](double value) {
    const double steps = value / step;
    return std::abs(steps - std::round(steps)) < kOff;
  });
}

DecimalStep coarsest(std::span<const double> values, std::initializer_list<DecimalStep> steps) {
  for (const DecimalStep& step : steps) {
    if (are_multiples(values, step.size)) return step;
  }
  return {};
}

}  // namespace

double DecimalStep::sigma() const { return size / std::sqrt(12.0); }

DecimalStep step_of_lengths(std::span<const double> values) {
  return coarsest(values,
                  {{1e-3, "1 mm"}, {1e-4, "0.1 mm"}, {1e-5, "0.01 mm"}, {1e-6, "0.001 mm"}});
}

DecimalStep step_of_angles(std::span<const double> values) {
  return coarsest(values, {{kDegree, "1 deg"},
                           {1e-2, "0.01 rad"},
                           {1e-1 * kDegree, "0.1 deg"},
                           {1e-3, "0.001 rad"},
                           {1e-2 * kDegree, "0.01 deg"},
                           {1e-4, "0.0001 rad"},
                           {1e-3 * kDegree, "0.001 deg"},
                           {1e-5, "0.00001 rad"}});
}

}  // namespace armtrue
