#include <numeric>

#include "fitter/effects/effect.h"
#include "fitter/effects/heat/lengths.h"

namespace armtrue {
namespace {

class WarmUp final : public Effect {
 public:
  std::string id() const override { return "warm_up"; }
  std::string summary() const override { return "the arm warms with no thermometer on it"; }
  JointRule joint_rule() const override { return JointRule::kNone; }
  std::string bound_text() const override {
    return "1e-3 of length, 2e-3 rad; time constant 1 min to 10 h: links grow by 120 to 340 ppm";
  }

  std::vector<EffectOption> options() const override {
    return {{"tau", "s", "time constant, default found from the data"}};
  }

  std::vector<std::string> missing(const EffectContext& context,
                                   const std::vector<int>&) const override {
    if (context.state.has("time")) return {};
    return {"time"};
  }

  std::vector<std::string> searched_options() const override { return {"tau"}; }

  EffectTerms build(const EffectContext& context, const EffectRequest& request) const override {
    EffectTerms terms;
    std::string tau = "warm_up_tau";
    if (request.options.contains("tau")) {
      tau = Expression::number(request.options["tau"].get<double>()).to_string();
    } else {
      NonlinearParameter p{
          tau, id(), {}, "s", 1800.0, 60.0, 36000.0, {300.0, 900.0, 1800.0, 3600.0, 7200.0}, "tau"};
      terms.nonlinear.push_back(p);
    }
    // Before the first measurement the arm is as cold as at that measurement.
    const std::string warmth = "1 - exp(-max(time, 0)/" + tau + ")";
    const int n = context.joint_count();
    std::vector<int> links(static_cast<std::size_t>(n) + 1);
    std::iota(links.begin(), links.end(), 0);
    terms.parameters.push_back(
        grown_lengths(context.robot(), id(), {}, "lengths", "m/m", 1e-3, links, warmth));
    for (int k = 1; k <= n; ++k) {
      terms.parameters.push_back(
          single_term(id(), {}, "motor" + std::to_string(k), "rad", 2e-3, motor(k), warmth));
    }
    return terms;
  }

  std::vector<EffectRequest> candidates(const EffectContext&) const override {
    std::vector<EffectRequest> result;
    for (const double tau : {300.0, 900.0, 1800.0, 3600.0, 7200.0})
      result.push_back({id(), {}, {{"tau", tau}}});
    return result;
  }
};

const RegisterEffect<WarmUp> registered_warm_up;

}  // namespace
}  // namespace armtrue
