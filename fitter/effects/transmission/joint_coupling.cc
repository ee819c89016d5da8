#include "fitter/effects/effect.h"

namespace armtrue {
namespace {

class JointCoupling final : public Effect {
 public:
  JointCoupling()
      : Effect({.id = "joint_coupling",
                .summary = "wrist gears that turn each other",
                .bound = "2e-2 rad/rad: residual coupling is tens of arcseconds",
                .joints = JointRule::kPair,
                .drives = DriveRule::kDriving}) {}

  std::vector<int> default_joints(const EffectContext& context) const override {
    const int n = context.joint_count();
    if (n < 3) return {};
    return {n - 1, n - 2, n, n - 2, n, n - 1};
  }

  EffectTerms build(const EffectContext& context, const EffectRequest& request) const override {
    EffectTerms terms;
    for (std::size_t i = 0; i + 1 < request.joints.size(); i += 2) {
      const int driven = request.joints[i];
      const int driving = request.joints[i + 1];
      if (driven == driving)
        throw ModelError("effect joint_coupling: joint " + std::to_string(driven) +
                         " cannot drive itself");
      const std::string unit = std::string(context.prismatic(driven) ? "m" : "rad") +
                               (context.prismatic(driving) ? "/m" : "/rad");
      add(terms, {driven, driving}, "", unit, 2e-2, motor(driven), "q" + std::to_string(driving));
    }
    return terms;
  }

  std::vector<EffectRequest> candidates(const EffectContext& context) const override {
    std::vector<EffectRequest> result;
    for (int driven = 1; driven <= context.joint_count(); ++driven) {
      for (int driving = 1; driving <= context.joint_count(); ++driving) {
        if (driven != driving) result.push_back({id(), {driven, driving}});
      }
    }
    return result;
  }
};

const RegisterEffect<JointCoupling> registered_joint_coupling;

}  // namespace
}  // namespace armtrue
