#include "fitter/effects/instrument/sight.h"

namespace armtrue {
namespace {

class TrackerScale final : public Effect {
 public:
  TrackerScale()
      : Effect({.id = "tracker_scale",
                .summary = "the instrument's distances are too long or short",
                .bound = "2e-4: ours, air 30 K or 80 hPa other than the weather station's makes a "
                         "quarter of it; a constant of 2e-4 m: ours, several times a distance "
                         "meter's drift until it is set",
                .role = Role::kMeasurement,
                .joints = JointRule::kNone,
                .options = {{"constant", "bool",
                             "all distances are off by one length, not in proportion"}}}) {}

  EffectTerms build(const EffectContext& context, const EffectRequest& request) const override {
    const Sight s = line_of_sight(context);
    EffectTerms terms;
    if (request.options.value("constant", false)) {
      const std::string of = "/" + s.distance;
      shift_of_point(context, *this, "constant", "m", kLargestConstant,
                     {s.x + of, s.y + of, s.z + of}, terms);
    } else {
      shift_of_point(context, *this, "", "m/m", kLargest, {s.x, s.y, s.z}, terms);
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
