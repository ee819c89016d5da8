#include "fitter/effects/heat/lengths.h"

#include <cmath>

namespace armtrue {

Parameter& grown_lengths(const EffectContext& context, const Effect& effect,
                         const std::vector<int>& joints, const std::string& suffix,
                         const std::string& unit, double bound, int first, int last,
                         const std::string& growth, EffectTerms& terms) {
  Parameter& p = effect.add(terms, joints, suffix, unit, bound, {}, growth);
  const Term term = std::move(p.terms.front());
  p.terms.clear();
  for (int link = first; link <= last; ++link) {
    const Pose& next = link == context.joint_count()
                           ? context.robot().end
                           : context.robot().joints[static_cast<std::size_t>(link)].fixed;
    for (int c = 0; c < 3; ++c) {
      const double length = next.translation()[c];
      if (std::abs(length) < 1e-9) continue;
      p.terms.push_back(term);
      p.terms.back().coordinate = link == 0 ? on_base(c) : on_link(link, c);
      p.terms.back().weight = length;
    }
  }
  return p;
}

}  // namespace armtrue
