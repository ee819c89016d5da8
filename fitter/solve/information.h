// Bayesian information criterion of a fit.
#pragma once

#include "fitter/solve/fit.h"

namespace armtrue {

/// Bayesian information criterion of a fit, up to a constant of the data set: comparable between
/// fits of the same rows.
double bayesian_information(Fit& fit);

}  // namespace armtrue
