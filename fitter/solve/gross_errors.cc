#include "fitter/solve/gross_errors.h"

#include <algorithm>

#include "fitter/common/statistics.h"

namespace armtrue {
namespace {

// A bumped reflector stands this many robust standard deviations out; model errors of honest rows
// do not.
constexpr double kGrossError = 8.0;
constexpr double kLargestGrossShare = 0.1;
constexpr double kAboveStructure = 3.0;
constexpr double kNoArmErrs = 0.01;  // of its reach, beside fitted base, tool and zeros

}  // namespace

// A local effect that the model lacks can stand out on many poses: bumps must stand out from those
// too, unless by more than any arm errs. Such rows belong to other poses, be they a third of all.
double gross_limit(const std::vector<double>& distance, double reach) {
  const double structure = kAboveStructure * quantile(distance, 1.0 - kLargestGrossShare);
  return std::max(kGrossError * median(distance) / kMedianChi3,
                  std::min(structure, kNoArmErrs * reach));
}

}  // namespace armtrue
