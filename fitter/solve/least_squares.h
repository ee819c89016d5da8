// Nonlinear least squares over a design, with its analytic Jacobian.
#pragma once

#include <string>

#include "fitter/design/design.h"

namespace armtrue {

/// Accuracy of a solution: one that is followed by another (rows are rejected, the noise is
/// rescaled) need not converge to the last digit.
enum class Accuracy { kOnTheWay, kFull };

struct SolveSummary {
  int iterations = 0;
  bool converged = false;
  double cost = 0.0;  ///< Σ r², penalties included
  std::string message;
};

/// Minimises Σ r² with priors and penalties, starting from the design's present values, and stores
/// the solution in the design. Gauss–Newton steps on the normal equations, damped if they do not
/// lower the cost; nonlinear parameters stay within their bounds.
SolveSummary solve(Design& design, double smoothness_sigma, Accuracy accuracy = Accuracy::kFull);

}  // namespace armtrue
