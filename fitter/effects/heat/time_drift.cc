#include <algorithm>

#include "fitter/effects/effect.h"

namespace armtrue {
namespace {

class TimeDrift final : public Effect {
 public:
  TimeDrift()
      : Effect({.id = "time_drift",
                .summary = "tracker or base creeps over the session",
                .bound = "1 mm/h, 1 mrad/h: trackers drift 30 to 130 um a day",
                .role = Role::kMeasurement,
                .joints = JointRule::kNone,
                .columns = {"time"}}) {}

  // Hours since the first measurement, so that the base reference is that of the session's start.
  EffectTerms build(const EffectContext& context, const EffectRequest&) const override {
    EffectTerms terms;
    const std::vector<double>& time = context.state.column("time");
    const double start = *std::min_element(time.begin(), time.end());
    const std::string hours = "(time - " + Expression::number(start).to_string() + ")/3600";
    for (int c = 0; c < 6; ++c) {
      add(terms, {}, kComponentNames[c], c < 3 ? "m/h" : "rad/h", 1e-3, on_base(c), hours);
    }
    return terms;
  }
};

const RegisterEffect<TimeDrift> registered_time_drift;

}  // namespace
}  // namespace armtrue
