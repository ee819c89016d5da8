#include "fitter/effects/effect.h"

namespace armtrue {
namespace {

class GearHarmonics final : public Effect {
 public:
  GearHarmonics()
      : Effect({.id = "gear_harmonics",
                .summary = "eccentricity of gear or encoder: once and twice per joint turn",
                .bound = "2.5e-3 rad: 10 to 60 arcsec are usual",
                .drives = DriveRule::kEach,
                .motion = Motion::kTurning,
                .options = {{"orders", "[int]", "cycles per joint turn, default [1, 2]"}},
                .told_apart = {"orders"}}) {}

  std::vector<std::string> missing(const EffectContext& context,
                                   const std::vector<int>& joints) const override {
    std::vector<std::string> lacking = Effect::missing(context, joints);
    for (std::string& joint : lacking)
      joint += " (waves over a slide are gear_mesh's, with its lead)";
    return lacking;
  }

  EffectTerms build(const EffectContext&, const EffectRequest& request) const override {
    EffectTerms terms;
    const std::vector<int> orders = request.options.value("orders", std::vector<int>{1, 2});
    for (const int k : request.joints) {
      for (const int order : orders) {
        const std::string times = order == 1 ? "" : std::to_string(order) + "*";
        const std::string angle = times + "q" + std::to_string(k);
        for (const std::string wave : {"sin", "cos"}) {
          add(terms, {k}, wave + std::to_string(order), "rad", kLargest, motor(k),
              wave + "(" + angle + ")")
              .usual = kUsual;
        }
      }
    }
    return terms;
  }

 private:
  static constexpr double kLargest = 2.5e-3;  // [rad]
  static constexpr double kUsual = 2.9e-4;    // [rad], 60 arcsec
};

const RegisterEffect<GearHarmonics> registered_gear_harmonics;

}  // namespace
}  // namespace armtrue
