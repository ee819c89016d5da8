#include "fitter/effects/effect.h"

namespace armtrue {
namespace {

class GearHarmonics final : public Effect {
 public:
  std::string id() const override { return "gear_harmonics"; }
  std::string summary() const override {
    return "eccentricity of gear or encoder: once and twice per joint turn";
  }
  JointRule joint_rule() const override { return JointRule::kEach; }
  DriveRule drive_rule() const override { return DriveRule::kEach; }
  std::string bound_text() const override { return "2.5e-3 rad: 10 to 60 arcsec are usual"; }

  std::vector<EffectOption> options() const override {
    return {{"orders", "[int]", "cycles per joint turn, default [1, 2]"}};
  }

  std::vector<std::string> told_apart_by() const override { return {"orders"}; }

  std::vector<std::string> missing(const EffectContext& context,
                                   const std::vector<int>& joints) const override {
    std::vector<std::string> lacking;
    for (const int k : joints) {
      if (context.prismatic(k))
        lacking.push_back("a revolute joint " + std::to_string(k) +
                          " (waves over a slide are gear_mesh's, with its lead)");
    }
    return lacking;
  }

  std::vector<int> default_joints(const EffectContext& context) const override {
    std::vector<int> joints;
    for (int k = 1; k <= context.joint_count(); ++k) {
      if (!context.prismatic(k)) joints.push_back(k);
    }
    return joints;
  }

  EffectTerms build(const EffectContext&, const EffectRequest& request) const override {
    EffectTerms terms;
    const std::vector<int> orders = request.options.value("orders", std::vector<int>{1, 2});
    for (const int k : request.joints) {
      for (const int order : orders) {
        const std::string times = order == 1 ? "" : std::to_string(order) + "*";
        const std::string angle = times + "q" + std::to_string(k);
        for (const std::string wave : {"sin", "cos"}) {
          terms.parameters.push_back(single_term(id(), {k}, wave + std::to_string(order), "rad",
                                                 kLargest, motor(k), wave + "(" + angle + ")"));
          terms.parameters.back().usual = kUsual;
        }
      }
    }
    return terms;
  }

  std::vector<EffectRequest> candidates(const EffectContext& context) const override {
    std::vector<EffectRequest> result;
    for (const int k : default_joints(context)) result.push_back({id(), {k}});
    return result;
  }

 private:
  static constexpr double kLargest = 2.5e-3;  // [rad]
  static constexpr double kUsual = 2.9e-4;    // [rad], 60 arcsec
};

const RegisterEffect<GearHarmonics> registered_gear_harmonics;

}  // namespace
}  // namespace armtrue
