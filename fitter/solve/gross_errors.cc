#include "fitter/solve/gross_errors.h"

#include <algorithm>

#include "fitter/common/statistics.h"

namespace armtrue {
namespace {

// In robust standard deviations: a bumped reflector exceeds it, model errors of valid rows do not.
constexpr double kGrossError = 8.0;
constexpr double kLargestGrossShare = 0.1;
constexpr double kAboveStructure = 3.0;
constexpr double kNoArmErrs = 0.01;  // of its reach, once base, tool and zeros are fitted

}  // namespace

// A local effect that the model lacks can stand out on many poses, so gross errors must exceed
// those too, or be larger than any arm errs: such rows belong to other poses, even if they are a
// third of all.
double gross_limit(const std::vector<double>& distance, double reach) {
  const double structure = kAboveStructure * quantile(distance, 1.0 - kLargestGrossShare);
  return std::max(kGrossError * median(distance) / kMedianChi3,
                  std::min(structure, kNoArmErrs * reach));
}

}  // namespace armtrue
