#include "fitter/effects/effect.h"

namespace armtrue {
namespace {

class JointScale final : public Effect {
 public:
  std::string id() const override { return "joint_scale"; }
  std::string summary() const override { return "gear ratio or encoder scale error"; }
  JointRule joint_rule() const override { return JointRule::kEach; }
  DriveRule drive_rule() const override { return DriveRule::kEach; }
  std::string bound_text() const override {
    return "2e-3, of a sliding joint 5e-4: ours, a wrong tooth or pulse count shows as more and is "
           "a units mistake; a screw or rack is off by 200 ppm at most and grows by 12 ppm/K";
  }
  std::string describe(const Parameter& p) const override {
    return "axis " + std::to_string(p.joints.front()) + "'s scale";
  }

  EffectTerms build(const EffectContext& context, const EffectRequest& request) const override {
    EffectTerms terms;
    for (const int k : request.joints) {
      const bool slides = context.prismatic(k);
      terms.parameters.push_back(single_term(id(), {k}, "", slides ? "m/m" : "rad/rad",
                                             slides ? kLargestOfASlide : kLargest, motor(k),
                                             "q" + std::to_string(k)));
    }
    return terms;
  }

 private:
  static constexpr double kLargest = 2e-3, kLargestOfASlide = 5e-4;
};

const RegisterEffect<JointScale> registered_joint_scale;

}  // namespace
}  // namespace armtrue
