#include "fitter/effects/effect.h"

namespace armtrue {
namespace {

class CouplingHarmonics final : public Effect {
 public:
  CouplingHarmonics()
      : Effect({.id = "coupling_harmonics",
                .summary = "hollow wrists: the waves of one joint's gears turn another",
                .bound = "2.5e-3 rad: ours, that of gear_harmonics, for the same gears make them",
                .joints = JointRule::kPair,
                .drives = DriveRule::kDriving,
                .options = {{"orders", "[int]",
                             "cycles per turn of the driving joint, default [1, 2]"}},
                .told_apart = {"orders"}}) {}

  std::vector<int> default_joints(const EffectContext& context) const override {
    const int n = context.joint_count();
    std::vector<int> pairs;
    if (n >= 3) pairs = {n - 1, n - 2, n, n - 2, n, n - 1};
    // Bars run beside every link that turns about an axis parallel to the passive joint's.
    for (int driven = 2; driven <= n; ++driven) {
      if (!context.robot().is_passive(driven)) continue;
      for (int driving = 1; driving < driven; ++driving) {
        if (are_parallel(context, driving, driven)) add_pair(driven, driving, pairs);
      }
    }
    return pairs;
  }

  EffectTerms build(const EffectContext& context, const EffectRequest& request) const override {
    EffectTerms terms;
    const std::vector<int> orders = request.options.value("orders", std::vector<int>{1, 2});
    for (std::size_t i = 0; i + 1 < request.joints.size(); i += 2) {
      const int driven = request.joints[i], driving = request.joints[i + 1];
      if (driven == driving) {
        throw ModelError("effect coupling_harmonics: joint " + std::to_string(driven) +
                         " cannot drive itself; its own waves are gear_harmonics");
      }
      const std::string turning = angle_of(context, driven, driving);
      for (const int order : orders) {
        const std::string number = std::to_string(order);
        const std::string angle = (order == 1 ? "" : number + "*") + turning;
        for (const std::string wave : {"sin", "cos"}) {
          add(terms, {driven, driving}, wave + number, "rad", kLargest, motor(driven),
              wave + "(" + angle + ")");
        }
      }
    }
    return terms;
  }

  std::vector<EffectRequest> candidates(const EffectContext& context) const override {
    std::vector<EffectRequest> result;
    const std::vector<int> pairs = default_joints(context);
    for (std::size_t i = 0; i + 1 < pairs.size(); i += 2) {
      if (!context.prismatic(pairs[i]) && !context.prismatic(pairs[i + 1]))
        result.push_back({id(), {pairs[i], pairs[i + 1]}});
    }
    return result;
  }

 private:
  static constexpr double kLargest = 2.5e-3;  // [rad]

  static void add_pair(int driven, int driving, std::vector<int>& pairs) {
    for (std::size_t i = 0; i < pairs.size(); i += 2) {
      if (pairs[i] == driven && pairs[i + 1] == driving) return;
    }
    pairs.insert(pairs.end(), {driven, driving});
  }

  // The bars that move a passive joint depend on the orientation of link `driving` in their plane:
  // its own angle plus those of the joints before it that drive the same bars.
  static std::string angle_of(const EffectContext& context, int driven, int driving) {
    const std::string own = "q" + std::to_string(driving);
    const double ratio = context.robot().coupling(driven - 1, driving - 1);
    if (!context.robot().is_passive(driven) || ratio == 0.0) return own;
    std::string sum = own;
    for (int k = driving - 1; k >= 1; --k) {
      const double share = context.robot().coupling(driven - 1, k - 1) / ratio;
      if (share == 0.0) continue;
      const std::string factor =
          share == 1.0 ? "" : "(" + Expression::number(share).to_string() + ")*";
      sum += " + " + factor + "q" + std::to_string(k);
    }
    return sum == own ? own : "(" + sum + ")";
  }
};

const RegisterEffect<CouplingHarmonics> registered_coupling_harmonics;

}  // namespace
}  // namespace armtrue
