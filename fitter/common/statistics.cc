#include "fitter/common/statistics.h"

#include <algorithm>
#include <boost/math/distributions/chi_squared.hpp>
#include <boost/math/special_functions/beta.hpp>
#include <boost/math/special_functions/gamma.hpp>
#include <cmath>

namespace armtrue {
namespace {

// Below this the survival function underflows and the leading term of its continued fraction is
// used in logarithms.
constexpr double kTiny = 1e-280;

// log10 of the regularised incomplete beta function I_x(a, b) for small values: x^a (1−x)^b / (a
// B(a,b)) · (1 + O(x)).
double log10_ibeta_leading(double a, double b, double x) {
  const double log_beta = std::lgamma(a) + std::lgamma(b) - std::lgamma(a + b);
  return (a * std::log(x) + b * std::log1p(-x) - std::log(a) - log_beta) / std::log(10.0);
}

}  // namespace

double quantile(std::vector<double> values, double p) {
  if (values.empty()) return 0.0;
  const double at = p * static_cast<double>(values.size() - 1);
  const auto low = static_cast<std::size_t>(at);
  std::nth_element(values.begin(), values.begin() + static_cast<std::ptrdiff_t>(low), values.end());
  const double first = values[low];
  if (low + 1 >= values.size()) return first;
  const double second =
      *std::min_element(values.begin() + static_cast<std::ptrdiff_t>(low) + 1, values.end());
  return first + (at - static_cast<double>(low)) * (second - first);
}

double median(std::vector<double> values) { return quantile(std::move(values), 0.5); }

ErrorSummary summarise(const std::vector<double>& distances) {
  ErrorSummary s;
  s.count = distances.size();
  if (distances.empty()) return s;
  double sum = 0.0, squares = 0.0;
  for (const double d : distances) {
    sum += d;
    squares += d * d;
    s.max = std::max(s.max, d);
  }
  s.mean = sum / static_cast<double>(s.count);
  s.rms = std::sqrt(squares / static_cast<double>(s.count));
  s.p95 = quantile(distances, 0.95);
  return s;
}

double log10_f_survival(double f, double d1, double d2) {
  if (!(f > 0.0) || d1 <= 0.0 || d2 <= 0.0) return 0.0;
  const double x = d2 / (d2 + d1 * f);
  const double survival = boost::math::ibeta(d2 / 2.0, d1 / 2.0, x);
  return survival > kTiny ? std::log10(survival) : log10_ibeta_leading(d2 / 2.0, d1 / 2.0, x);
}

double log10_chi2_survival(double x, double k) {
  if (!(x > 0.0) || k <= 0.0) return 0.0;
  const double survival = boost::math::gamma_q(k / 2.0, x / 2.0);
  if (survival > kTiny) return std::log10(survival);
  const double a = k / 2.0;
  return ((a - 1.0) * std::log(x / 2.0) - x / 2.0 - std::lgamma(a)) / std::log(10.0);
}

}  // namespace armtrue
