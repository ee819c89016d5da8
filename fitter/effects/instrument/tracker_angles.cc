#include "fitter/effects/instrument/sight.h"

namespace armtrue {
namespace {

class TrackerAngles final : public Effect {
 public:
  std::string id() const override { return "tracker_angles"; }
  std::string summary() const override {
    return "the instrument's circles sit off their axes: errors once a turn";
  }
  Role role() const override { return Role::kMeasurement; }
  JointRule joint_rule() const override { return JointRule::kNone; }
  std::string bound_text() const override {
    return "1e-4 rad: ours, twice what a tracker out of calibration shows";
  }

  // An azimuth error turns the point about the instrument's upright axis, one of elevation about
  // the level axis across the line of sight.
  EffectTerms build(const EffectContext& context, const EffectRequest&) const override {
    const Sight s = line_of_sight(context);
    EffectTerms terms;
    const auto add = [&](const std::string& suffix, const std::string& wave, bool is_azimuth) {
      const std::string along = wave + "*";
      const std::array<std::string, 3> azimuth{"(-1)*" + along + s.y, along + s.x, ""};
      const std::string down = "(-1)*" + along + s.z + "/" + s.across + "*";
      const std::array<std::string, 3> elevation{down + s.x, down + s.y, along + s.across};
      terms.parameters.push_back(
          shift_of_point(context, id(), suffix, "rad", kLargest, is_azimuth ? azimuth : elevation));
    };
    add("azimuth_sin", "(" + s.y + "/" + s.across + ")", true);
    add("azimuth_cos", "(" + s.x + "/" + s.across + ")", true);
    add("elevation_sin", "(" + s.z + "/" + s.distance + ")", false);
    add("elevation_cos", "(" + s.across + "/" + s.distance + ")", false);
    return terms;
  }

 private:
  static constexpr double kLargest = 1e-4;  // [rad]
};

const RegisterEffect<TrackerAngles> registered_tracker_angles;

}  // namespace
}  // namespace armtrue
