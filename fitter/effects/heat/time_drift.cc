#include <algorithm>

#include "fitter/effects/effect.h"

namespace armtrue {
namespace {

class TimeDrift final : public Effect {
 public:
  std::string id() const override { return "time_drift"; }
  std::string summary() const override { return "tracker or base creeps over the session"; }
  Role role() const override { return Role::kMeasurement; }
  JointRule joint_rule() const override { return JointRule::kNone; }
  std::string bound_text() const override {
    return "1 mm/h, 1 mrad/h: trackers drift 30 to 130 um a day";
  }

  std::vector<std::string> missing(const EffectContext& context,
                                   const std::vector<int>&) const override {
    if (context.state.has("time")) return {};
    return {"time"};
  }

  // Hours since the first measurement, so that the base reference is that of the session's start.
  EffectTerms build(const EffectContext& context, const EffectRequest&) const override {
    EffectTerms terms;
    const std::vector<double>& time = context.state.column("time");
    const double start = *std::min_element(time.begin(), time.end());
    const std::string hours = "(time - " + Expression::number(start).to_string() + ")/3600";
    for (int c = 0; c < 6; ++c) {
      Parameter p = single_term(id(), {}, kComponentNames[c], c < 3 ? "m/h" : "rad/h", 1e-3,
                                on_base(c), hours);
      p.exported = false;
      terms.parameters.push_back(p);
    }
    return terms;
  }
};

const RegisterEffect<TimeDrift> registered_time_drift;

}  // namespace
}  // namespace armtrue
