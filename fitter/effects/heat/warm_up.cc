#include <initializer_list>

#include "fitter/effects/effect.h"
#include "fitter/effects/heat/lengths.h"

namespace armtrue {
namespace {

class WarmUp final : public Effect {
 public:
  WarmUp()
      : Effect({.id = "warm_up",
                .summary = "the arm warms with no thermometer on it",
                .bound = "1e-3 of length, 2e-3 rad; time constant 1 min to 10 h: links grow by 120 "
                         "to 340 ppm",
                .joints = JointRule::kNone,
                .options = {{"tau", "s", "time constant, default found from the data"}},
                .searched = {"tau"},
                .columns = {"time"}}) {}

  EffectTerms build(const EffectContext& context, const EffectRequest& request) const override {
    EffectTerms terms;
    const std::string tau = number_or_unknown(
        request, {"warm_up_tau", id(), {}, "s", 1800.0, 60.0, 36000.0, kTaus, "tau"}, terms);
    // Before the first measurement the arm is as cold as at that measurement.
    const std::string warmth = "1 - exp(-max(time, 0)/" + tau + ")";
    const int n = context.joint_count();
    grown_lengths(context, *this, {}, "lengths", "m/m", 1e-3, 0, n, warmth, terms);
    for (int k = 1; k <= n; ++k) {
      add(terms, {}, "motor" + std::to_string(k), "rad", 2e-3, motor(k), warmth);
    }
    return terms;
  }

  std::vector<EffectRequest> candidates(const EffectContext&) const override {
    std::vector<EffectRequest> result;
    for (const double tau : kTaus) result.push_back({id(), {}, {{"tau", tau}}});
    return result;
  }

 private:
  static constexpr std::initializer_list<double> kTaus = {300.0, 900.0, 1800.0, 3600.0, 7200.0};
};

const RegisterEffect<WarmUp> registered_warm_up;

}  // namespace
}  // namespace armtrue
