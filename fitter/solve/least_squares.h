// Nonlinear least squares over a design, with its analytic Jacobian.
#pragma once

#include <string>

#include "fitter/design/design.h"

namespace armtrue {

/// How far a solution goes: on the way to another one (rows to be left out, noise to be rescaled)
/// the cost need not settle to the last digit.
enum class Accuracy { kOnTheWay, kFull };

struct SolveSummary {
  int iterations = 0;
  bool converged = false;
  double cost = 0.0;  ///< Σ r², penalties included
  std::string message;
};

/// Minimises Σ r² with priors and penalties, starting from the design's present values, and leaves
/// the solution there: Gauss–Newton steps on the normal equations, damped where they do not
/// descend; nonlinear parameters stay within their bounds.
SolveSummary solve(Design& design, double smoothness_sigma, Accuracy accuracy = Accuracy::kFull);

}  // namespace armtrue
