#include <algorithm>
#include <cmath>

#include "fitter/effects/effect.h"

namespace armtrue {
namespace {

class CrossCompliance final : public Effect {
 public:
  std::string id() const override { return "cross_compliance"; }
  std::string summary() const override {
    return "a link bends in the plane of parallel axes: each one's torque "
           "turns the other";
  }
  JointRule joint_rule() const override { return JointRule::kPair; }
  std::string bound_text() const override {
    return "0 to 1e-2 rad under the larger of the two torques in the data, at most 1e-3 rad/Nm: "
           "ours, a joint's own torsion at most, for what bends between two axes is no softer "
           "than their gears";
  }

  std::vector<int> default_joints(const EffectContext& context) const override {
    for (int k = 1; k < context.joint_count(); ++k) {
      if (are_parallel(context, k)) return {k, k + 1};
    }
    return {};
  }

  std::vector<std::string> missing(const EffectContext& context,
                                   const std::vector<int>& joints) const override {
    std::vector<std::string> lacking;
    if (joints.empty()) lacking.emplace_back("two parallel axes");
    for (const int k : joints) {
      const std::string torque = "tau" + std::to_string(k);
      if (!context.state.has(torque))
        lacking.push_back(torque + " (or mass and com of robot.yaml's links)");
    }
    return lacking;
  }

  // One coefficient drives both: by Maxwell and Betti the compliance matrix is symmetric.
  EffectTerms build(const EffectContext& context, const EffectRequest& request) const override {
    EffectTerms terms;
    for (std::size_t i = 0; i + 1 < request.joints.size(); i += 2) {
      const int a = request.joints[i], b = request.joints[i + 1];
      if (a == b) {
        throw ModelError("effect cross_compliance: found joint " + std::to_string(a) +
                         " twice in a pair, expected two joints");
      }
      Parameter p =
          single_term(id(), {a, b}, "", "rad/Nm",
                      std::min(softest(context, "tau" + std::to_string(a), kLargest, kSoftest),
                               softest(context, "tau" + std::to_string(b), kLargest, kSoftest)),
                      motor(a), "tau" + std::to_string(b));
      p.terms.push_back(
          {motor(b), Expression::variable("tau" + std::to_string(a)), 1.0, std::nullopt});
      p.sign = 1;
      terms.parameters.push_back(p);
    }
    return terms;
  }

  std::vector<EffectRequest> candidates(const EffectContext& context) const override {
    std::vector<EffectRequest> result;
    for (int k = 1; k < context.joint_count(); ++k) {
      if (are_parallel(context, k)) result.push_back({id(), {k, k + 1}});
    }
    return result;
  }

 private:
  static constexpr double kLargest = 1e-2;  // [rad]
  static constexpr double kSoftest = 1e-3;  // [rad/Nm]

  // Whether the axes of joints k and k + 1 are parallel at any joint angle.
  static bool are_parallel(const EffectContext& context, int k) {
    if (context.prismatic(k) || context.prismatic(k + 1)) return false;
    const auto& next = context.robot().joints[static_cast<std::size_t>(k)].fixed;
    return std::abs(next.linear()(2, 2)) > 1.0 - 1e-6;
  }
};

const RegisterEffect<CrossCompliance> registered_cross_compliance;

}  // namespace
}  // namespace armtrue
