#include "fitter/effects/effect.h"

namespace armtrue {
namespace {

class CouplingHarmonics final : public Effect {
 public:
  std::string id() const override { return "coupling_harmonics"; }
  std::string summary() const override {
    return "hollow wrists: the waves of one joint's gears turn another";
  }
  JointRule joint_rule() const override { return JointRule::kPair; }
  std::string bound_text() const override {
    return "2.5e-3 rad: ours, that of gear_harmonics, for the same gears make them";
  }

  std::vector<EffectOption> options() const override {
    return {{"orders", "[int]", "cycles per turn of the driving joint, default [1, 2]"}};
  }

  std::vector<int> default_joints(const EffectContext& context) const override {
    const int n = context.joint_count();
    if (n < 3) return {};
    return {n - 1, n - 2, n, n - 2, n, n - 1};
  }

  EffectTerms build(const EffectContext&, const EffectRequest& request) const override {
    EffectTerms terms;
    const std::vector<int> orders = request.options.value("orders", std::vector<int>{1, 2});
    for (std::size_t i = 0; i + 1 < request.joints.size(); i += 2) {
      const int driven = request.joints[i], driving = request.joints[i + 1];
      if (driven == driving) {
        throw ModelError("effect coupling_harmonics: joint " + std::to_string(driven) +
                         " cannot drive itself; its own waves are gear_harmonics");
      }
      for (const int order : orders) {
        const std::string number = std::to_string(order);
        const std::string angle = (order == 1 ? "" : number + "*") + "q" + std::to_string(driving);
        for (const std::string wave : {"sin", "cos"}) {
          terms.parameters.push_back(single_term(id(), {driven, driving}, wave + number, "rad",
                                                 kLargest, motor(driven),
                                                 wave + "(" + angle + ")"));
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
};

const RegisterEffect<CouplingHarmonics> registered_coupling_harmonics;

}  // namespace
}  // namespace armtrue
