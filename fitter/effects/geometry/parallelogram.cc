#include <cmath>

#include "fitter/effects/effect.h"

namespace armtrue {
namespace {

class ParallelogramErrors final : public Effect {
 public:
  ParallelogramErrors()
      : Effect(
            {.id = "parallelogram",
             .summary = "four-bar bar-length and pivot errors",
             .bound =
                 "1e-2 rad, 3 mm on a bar at a crank of 0.3 m: the multilevel paper (ABB IRB2400)",
             .joints = JointRule::kFixed}) {}

  std::vector<int> default_joints(const EffectContext& context) const override {
    const auto& linkage = context.robot().parallelogram;
    return linkage ? std::vector<int>{linkage->crank_joint, linkage->arm_joint}
                   : std::vector<int>{2, 3};
  }

  std::vector<std::string> missing(const EffectContext& context,
                                   const std::vector<int>&) const override {
    if (context.robot().parallelogram) return {};
    return {"linkage in robot.yaml"};
  }

  // First order in the bar errors: d(theta3) = [(dl_d - dl_b) + (dl_c - dl_a) cos(beta) - (e_x
  // cos(theta2) + e_y sin(theta2))] / (a sin(beta)); four basis functions (derived from the closure
  // of the four bars; the IRB2400 paper's level 1 fits the same kind of functions).
  EffectTerms build(const EffectContext& context, const EffectRequest& request) const override {
    EffectTerms terms;
    const auto& linkage = *context.robot().parallelogram;
    const int crank = request.joints.at(0);
    const int arm = request.joints.at(1);
    const std::string theta2 = "q" + std::to_string(crank);
    const std::string beta =
        "(" + Expression::number(linkage.angle).to_string() + " + th" + std::to_string(arm) + ")";
    const auto add_wave = [&](const std::string& suffix, const std::string& numerator) {
      Parameter& p = add(terms, {crank, arm}, suffix, "rad", kLargest, on_link(arm, 5),
                         numerator + "/sin" + beta);
      // Bars that move a passive joint follow the link, with this error, and not its motor.
      for (int k = 1; k <= context.joint_count(); ++k) {
        if (!context.robot().is_passive(k)) continue;
        const double share = context.robot().followed_links(k)[arm - 1];
        if (std::abs(share) > 1e-9)
          p.terms.push_back({on_link(k, 5), p.terms.front().basis, share});
      }
    };
    add_wave("bars", "1");
    add_wave("cranks", "cos" + beta);
    add_wave("pivot_x", "cos(" + theta2 + ")");
    add_wave("pivot_y", "sin(" + theta2 + ")");
    return terms;
  }

  std::vector<EffectRequest> candidates(const EffectContext& context) const override {
    if (!context.robot().parallelogram) return {};
    return {{id(), default_joints(context)}};
  }

 private:
  static constexpr double kLargest = 1e-2;  // [rad]
};

const RegisterEffect<ParallelogramErrors> registered_parallelogram;

}  // namespace
}  // namespace armtrue
