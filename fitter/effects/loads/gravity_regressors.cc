#include "fitter/effects/loads/gravity_regressors.h"

#include <algorithm>
#include <cmath>

namespace armtrue {
namespace {

// Largest mass [kg] and first moment [kg m] of a link: sets the physical bound.
constexpr double kHeaviest = 500.0;
// Weak prior on each regressor, as the largest deflection [rad] that it causes in the data. With
// wider ones, regressors and zeros cancel inside the data and differ by millimetres outside
// (decision 0031).
constexpr double kDeflection = 2e-3;

double largest(const std::vector<double>& column) {
  double size = 0.0;
  for (const double v : column) size = std::max(size, std::abs(v));
  return size;
}

bool varies(const std::vector<double>& column) {
  const auto [low, high] = std::minmax_element(column.begin(), column.end());
  return *high - *low > 1e-9 * (1.0 + std::abs(*high));
}

}  // namespace

EffectTerms gravity_regressor_terms(const EffectContext& context, const std::string& effect,
                                    const std::vector<int>& joints, const std::string& regressor,
                                    const std::string& payload_regressor, Coordinate coordinate,
                                    double softest, const std::string& prefix) {
  EffectTerms terms;
  const int first = joints.empty() ? 1 : joints.front();
  for (int link = first; link <= context.joint_count(); ++link) {
    for (const char* component : {"m", "x", "y", "z"}) {
      const std::string suffix = std::to_string(link) + "_" + component;
      const std::string variable = regressor + "_" + suffix;
      // A constant regressor (an axis along gravity) is an offset, which belongs to geometry.
      if (!varies(context.state.column(variable))) continue;
      const bool mass = component[0] == 'm';
      terms.parameters.push_back(single_term(effect, joints, prefix + "link" + suffix,
                                             mass ? "rad/N/m*kg" : "rad/N", softest * kHeaviest,
                                             coordinate, variable));
      terms.parameters.back().prior_sigma = kDeflection / largest(context.state.column(variable));
    }
  }
  if (context.state.has(payload_regressor)) {
    Parameter p = single_term(effect, joints, prefix + "payload", "rad/Nm", softest, coordinate,
                              "payload*" + payload_regressor);
    p.sign = 1;
    terms.parameters.push_back(p);
  }
  return terms;
}

void append(EffectTerms& terms, EffectTerms more) {
  std::move(more.parameters.begin(), more.parameters.end(), std::back_inserter(terms.parameters));
  std::move(more.nonlinear.begin(), more.nonlinear.end(), std::back_inserter(terms.nonlinear));
  std::move(more.penalties.begin(), more.penalties.end(), std::back_inserter(terms.penalties));
}

}  // namespace armtrue
