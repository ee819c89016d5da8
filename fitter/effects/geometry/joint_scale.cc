#include "fitter/effects/effect.h"

namespace armtrue {
namespace {

class JointScale final : public Effect {
 public:
  JointScale()
      : Effect({.id = "joint_scale",
                .summary = "gear ratio or encoder scale error",
                .bound = "2e-3, of a sliding joint 5e-4: ours, a wrong tooth or pulse count shows "
                         "as more and is a units mistake; a screw or rack is off by 200 ppm at "
                         "most and grows by 12 ppm/K",
                .drives = DriveRule::kEach}) {}

  std::string describe(const Parameter& p) const override {
    return "axis " + std::to_string(p.joints.front()) + "'s scale";
  }

  EffectTerms build(const EffectContext& context, const EffectRequest& request) const override {
    EffectTerms terms;
    for (const int k : request.joints) {
      const std::string unit = motor_unit(context, k);
      add(terms, {k}, "", unit + "/" + unit, on_motor(context, k, kLargest, kLargestOfASlide),
          motor(k), "q" + std::to_string(k));
    }
    return terms;
  }

 private:
  static constexpr double kLargest = 2e-3, kLargestOfASlide = 5e-4;
};

const RegisterEffect<JointScale> registered_joint_scale;

}  // namespace
}  // namespace armtrue
