// The error that measurement noise and repeatability alone would leave.
#pragma once

#include <string>

#include "fitter/common/statistics.h"
#include "fitter/design/design.h"

namespace armtrue {

struct NoiseFloor {
  double mean = 0.0;   ///< mean distance [m] that measurement and repeatability alone would leave
  std::string source;  ///< repeats, sigma, targets, none
  std::size_t count = 0;  ///< degrees of freedom of repeats or distances
};

/// From repeats if there are enough, else from stated sigmas, else from distances between
/// reflectors. `train`, `effective_unknowns`: of the fit. `stated_sigma`: root mean square per axis
/// [m], before the fit scaled it.
NoiseFloor measure_noise_floor(Design& design, const ErrorSummary& train, double effective_unknowns,
                               double stated_sigma);

}  // namespace armtrue
