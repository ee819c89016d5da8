#include <algorithm>

#include "fitter/effects/effect.h"

namespace armtrue {
namespace {

class CrossCompliance final : public Effect {
 public:
  CrossCompliance()
      : Effect({.id = "cross_compliance",
                .summary =
                    "a link bends in the plane of parallel axes: each one's torque turns the other",
                .bound = "0 to 1e-2 rad under the larger of the two torques in the data, at most "
                         "1e-3 rad/Nm: ours, a joint's own torsion at most, for what bends between "
                         "two axes is no softer than their gears",
                .joints = JointRule::kPair}) {}

  std::vector<int> default_joints(const EffectContext& context) const override {
    for (int k = 1; k < context.joint_count(); ++k) {
      if (are_parallel(context, k, k + 1)) return {k, k + 1};
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
      const std::string torque_a = "tau" + std::to_string(a), torque_b = "tau" + std::to_string(b);
      Parameter& p = add(terms, {a, b}, "", "rad/Nm",
                         std::min(softest(context, torque_a, kLargest, kSoftest),
                                  softest(context, torque_b, kLargest, kSoftest)),
                         motor(a), torque_b);
      p.terms.push_back({motor(b), Expression::variable(torque_a)});
      p.sign = 1;
    }
    return terms;
  }

  std::vector<EffectRequest> candidates(const EffectContext& context) const override {
    std::vector<EffectRequest> result;
    for (int k = 1; k < context.joint_count(); ++k) {
      if (are_parallel(context, k, k + 1)) result.push_back({id(), {k, k + 1}});
    }
    return result;
  }

 private:
  static constexpr double kLargest = 1e-2;  // [rad]
  static constexpr double kSoftest = 1e-3;  // [rad/Nm]
};

const RegisterEffect<CrossCompliance> registered_cross_compliance;

}  // namespace
}  // namespace armtrue
