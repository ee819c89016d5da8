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

bool varies(const std::vector<double>& column) {
  const auto [low, high] = std::minmax_element(column.begin(), column.end());
  return *high - *low > 1e-9 * (1.0 + std::abs(*high));
}

}  // namespace

void add_gravity_regressors(const EffectContext& context, const Effect& effect,
                            const std::vector<int>& joints, const std::string& load,
                            Coordinate coordinate, double softest, const std::string& prefix,
                            EffectTerms& terms) {
  const int first = joints.empty() ? 1 : joints.front();
  for (int link = first; link <= context.joint_count(); ++link) {
    for (const std::string component : {"m", "x", "y", "z"}) {
      const std::string suffix = std::to_string(link) + "_" + component;
      const std::string variable = "u" + load + "_" + suffix;
      // A constant regressor (an axis along gravity) is an offset, which belongs to geometry.
      if (!varies(context.state.column(variable))) continue;
      effect
          .add(terms, joints, prefix + "link" + suffix, component == "m" ? "rad/N/m*kg" : "rad/N",
               softest * kHeaviest, coordinate, variable)
          .prior_sigma = kDeflection / largest_of(context, variable);
    }
  }
  if (!context.state.has("up" + load)) return;
  effect.add(terms, joints, prefix + "payload", "rad/Nm", softest, coordinate, "payload*up" + load)
      .sign = 1;
}

void add_tilting(const EffectContext& context, const Effect& effect, int link,
                 const Softness& limits, EffectTerms& terms) {
  const std::vector<int> joints = link == 0 ? std::vector<int>{} : std::vector<int>{link};
  const std::string number = std::to_string(link);
  for (int c = 0; c < 2; ++c) {
    const std::string axis = c == 0 ? "x" : "y";
    const std::string moment = link == 0 ? "bm" + axis : "gm" + axis + number;
    const Coordinate place = link == 0 ? on_base(3 + c) : on_link(link, 3 + c);
    if (!context.state.has(moment)) {
      add_gravity_regressors(context, effect, joints, axis + "_" + number, place, limits.unknown,
                             "r" + axis + "_", terms);
      continue;
    }
    Parameter& p =
        effect.add(terms, joints, "r" + axis, "rad/Nm",
                   softest(context, moment, limits.largest, limits.softest), place, moment);
    p.sign = 1;
    p.alike = true;  // most stands and bearings are as soft about x as about y
  }
}

}  // namespace armtrue
