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
    return "2e-4: ours, air 30 K or 80 hPa other than the weather station's makes a quarter of it";
  }

  EffectTerms build(const EffectContext& context, const EffectRequest&) const override {
    const Sight s = line_of_sight(context);
    EffectTerms terms;
    terms.parameters.push_back(shift_of_point(context, id(), "", "m/m", kLargest, {s.x, s.y, s.z}));
    return terms;
  }

 private:
  static constexpr double kLargest = 2e-4;
};

const RegisterEffect<TrackerScale> registered_tracker_scale;

}  // namespace
}  // namespace armtrue
