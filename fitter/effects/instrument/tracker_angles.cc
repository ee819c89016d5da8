#include "fitter/effects/instrument/sight.h"

namespace armtrue {
namespace {

class TrackerAngles final : public Effect {
 public:
  TrackerAngles()
      : Effect({.id = "tracker_angles",
                .summary = "the instrument's circles sit off their axes, or are oval: errors once "
                           "or twice a turn",
                .bound = "1e-4 rad once a turn, half of it twice: ours, twice what a tracker out "
                         "of calibration shows",
                .role = Role::kMeasurement,
                .joints = JointRule::kNone,
                .options = {{"orders", "[int]", "1, once a turn, and 2, twice; default [1]"}}}) {}

  // An azimuth error turns the point about the instrument's vertical axis, an elevation error about
  // the horizontal axis across the line of sight. Order 2: the second-order errors of a tracker's
  // encoders (Muralikrishnan et al., Measuring scale errors in a laser tracker's horizontal angle
  // encoder through simple length measurement and two-face system tests, J. Res. NIST 115, 2010).
  EffectTerms build(const EffectContext& context, const EffectRequest& request) const override {
    const Sight s = line_of_sight(context);
    EffectTerms terms;
    const auto add_wave = [&](const std::string& suffix, int order, const std::string& wave,
                              bool is_azimuth) {
      const std::string along = wave + "*";
      const std::array<std::string, 3> azimuth{"(-1)*" + along + s.y, along + s.x, ""};
      const std::string down = "(-1)*" + along + s.z + "/" + s.across + "*";
      const std::array<std::string, 3> elevation{down + s.x, down + s.y, along + s.across};
      shift_of_point(context, *this, suffix + (order == 1 ? "" : std::to_string(order)), "rad",
                     kLargest / order, is_azimuth ? azimuth : elevation, terms);
    };
    for (const int order : request.options.value("orders", std::vector<int>{1})) {
      if (order != 1 && order != 2) {
        throw ModelError("effect tracker_angles: found order " + std::to_string(order) +
                         ", expected 1 or 2");
      }
      const auto add_circle = [&](const std::string& circle, const std::string& sine,
                                  const std::string& cosine, bool is_azimuth) {
        add_wave(circle + "_sin", order, order == 1 ? sine : "(2*" + sine + "*" + cosine + ")",
                 is_azimuth);
        add_wave(circle + "_cos", order,
                 order == 1 ? cosine : "(" + cosine + "^2 - " + sine + "^2)", is_azimuth);
      };
      add_circle("azimuth", "(" + s.y + "/" + s.across + ")", "(" + s.x + "/" + s.across + ")",
                 true);
      add_circle("elevation", "(" + s.z + "/" + s.distance + ")",
                 "(" + s.across + "/" + s.distance + ")", false);
    }
    return terms;
  }

  std::vector<EffectRequest> candidates(const EffectContext&) const override {
    return {{id(), {}}, {id(), {}, {{"orders", {2}}}}};
  }

 private:
  static constexpr double kLargest = 1e-4;  // [rad]
};

const RegisterEffect<TrackerAngles> registered_tracker_angles;

}  // namespace
}  // namespace armtrue
