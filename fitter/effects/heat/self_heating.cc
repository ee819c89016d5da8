#include <cmath>

#include "fitter/effects/effect.h"
#include "fitter/effects/heat/lengths.h"

namespace armtrue {
namespace {

class SelfHeating final : public Effect {
 public:
  SelfHeating()
      : Effect(
            {.id = "self_heating",
             .summary = "a gear's own warmth, later than any sensor: its zero and its link follow "
                        "its duty or a temperature, low-passed",
             .bound = "1e-3 rad and 1e-3 of the link's length at the largest warmth in the data: "
                      "ours, five times what gears show; time constant 5 min to 2 h",
             .drives = DriveRule::kEach,
             .options = {{"tau", "s", "time constant; the diagnosis tries several, default 1500"},
                         {"sensor", "string",
                          "temperature sensor that the gear follows, default its duty where that "
                          "is recorded, else the first"}}}) {}

  std::vector<std::string> missing(const EffectContext& context,
                                   const std::vector<int>& joints) const override {
    std::vector<std::string> lacking;
    if (!context.state.has("time")) lacking.emplace_back("time");
    for (const int k : joints) {
      if (!has_duty(context, k) && context.state.sensors().empty())
        lacking.push_back("duty" + std::to_string(k));
    }
    return lacking;
  }

  // A gear's own warmth does not follow from what a device or a single pose knows. The effect is
  // fitted, so that no other takes its place, and left out of tables; predictions describe the arm
  // at its average warmth.
  EffectTerms build(const EffectContext& context, const EffectRequest& request) const override {
    EffectTerms terms;
    const std::string tau = std::to_string(std::lround(request.options.value("tau", kTypical)));
    for (const int k : request.joints) {
      const std::string sensor = sensor_of(context, request, k);
      const std::string variable =
          sensor.empty() ? "warm" + std::to_string(k) + "_" + tau : "lag" + tau + "_" + sensor;
      const double largest = largest_of(context, variable);
      // Minus its mean: predictions and tables then describe the arm at its average warmth.
      const std::string warmth =
          "(" + variable + " - " + Expression::number(mean_of(context, variable)).to_string() + ")";
      const double bound = largest > 0.0 ? kLargest / largest : kLargest;
      const std::string unit = motor_unit(context, k);
      const std::string of = sensor.empty() ? "/(" + unit + "/s)" : "/K";
      add(terms, {k}, "zero", unit + of, bound, motor(k), warmth);
      if (grown_lengths(context, *this, {k}, "length", "1" + of, bound, k, k, warmth, terms)
              .terms.empty())
        terms.parameters.pop_back();
    }
    for (Parameter& p : terms.parameters) p.exported = false;
    return terms;
  }

  std::vector<EffectRequest> candidates(const EffectContext& context) const override {
    std::vector<EffectRequest> result;
    for (int k = 1; k <= context.joint_count(); ++k) {
      for (const double tau : {500.0, 700.0, 1000.0, 1400.0, 2000.0, 2800.0, 4000.0}) {
        if (has_duty(context, k)) {
          result.push_back({id(), {k}, {{"tau", tau}}});
          continue;
        }
        for (const std::string& sensor : context.state.sensors())
          result.push_back({id(), {k}, {{"tau", tau}, {"sensor", sensor}}});
        if (context.state.sensors().empty()) result.push_back({id(), {k}, {{"tau", tau}}});
      }
    }
    return result;
  }

 private:
  static constexpr double kTypical = 1500.0;  // [s]
  static constexpr double kLargest = 1e-3;    // [rad, m, or share of a length]

  static bool has_duty(const EffectContext& context, int joint) {
    return context.state.has("duty" + std::to_string(joint));
  }

  // The temperature sensor of a gear; empty if the gear follows its duty.
  static std::string sensor_of(const EffectContext& context, const EffectRequest& request,
                               int joint) {
    if (request.options.contains("sensor")) return request.options["sensor"].get<std::string>();
    return has_duty(context, joint) || context.state.sensors().empty()
               ? ""
               : context.state.sensors().front();
  }
};

const RegisterEffect<SelfHeating> registered_self_heating;

}  // namespace
}  // namespace armtrue
