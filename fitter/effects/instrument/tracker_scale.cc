#include "fitter/effects/instrument/sight.h"

namespace armtrue {
namespace {

class TrackerScale final : public Effect {
 public:
  std::string id() const override { return "tracker_scale"; }
  std::string summary() const override {
    return "the instrument's distances are too long or short";
  }
  Role role() const override { return Role::kMeasurement; }
  JointRule joint_rule() const override { return JointRule::kNone; }
  std::string bound_text() const override {
    return "2e-4: ours, air 30 K or 80 hPa other than the weather station's makes a quarter of "
           "it; a constant of 2e-4 m: ours, several times a distance meter's drift until it is set";
  }
  std::vector<EffectOption> options() const override {
    return {{"constant", "bool", "all distances are off by one length, not in proportion"}};
  }

  EffectTerms build(const EffectContext& context, const EffectRequest& request) const override {
    const Sight s = line_of_sight(context);
    EffectTerms terms;
    if (request.options.value("constant", false)) {
      const std::string of = "/" + s.distance;
      terms.parameters.push_back(shift_of_point(context, id(), "constant", "m", kLargestConstant,
                                                {s.x + of, s.y + of, s.z + of}));
    } else {
      terms.parameters.push_back(
          shift_of_point(context, id(), "", "m/m", kLargest, {s.x, s.y, s.z}));
    }
    return terms;
  }

  std::vector<EffectRequest> candidates(const EffectContext&) const override {
    return {{id(), {}}, {id(), {}, {{"constant", true}}}};
  }

 private:
  static constexpr double kLargest = 2e-4;
  static constexpr double kLargestConstant = 2e-4;  // [m]
};

const RegisterEffect<TrackerScale> registered_tracker_scale;

}  // namespace
}  // namespace armtrue
