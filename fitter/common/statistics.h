// Small statistics that several parts share.
#pragma once

#include <vector>

namespace armtrue {

/// Median; 0 for no values.
double median(std::vector<double> values);
/// Linear-interpolated quantile, p in [0, 1]; 0 for no values.
double quantile(std::vector<double> values, double p);

/// Mean, root mean square, 95 % quantile and maximum of distances [m].
struct ErrorSummary {
  double mean = 0.0, rms = 0.0, p95 = 0.0, max = 0.0;
  std::size_t count = 0;
};
ErrorSummary summarise(const std::vector<double>& distances);

/// log10 of the probability that an F-distributed number with (d1, d2) degrees of freedom exceeds
/// f.
double log10_f_survival(double f, double d1, double d2);
/// log10 of the probability that a chi-squared number with k degrees of freedom exceeds x.
double log10_chi2_survival(double x, double k);

}  // namespace armtrue
