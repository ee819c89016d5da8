#include "fitter/effects/instrument/set_ups.h"

namespace armtrue {
namespace {

class Nest final : public Effect {
 public:
  std::string id() const override { return "nest"; }
  std::string summary() const override {
    return "a reflector that was taken out sits elsewhere when it is put back";
  }
  Role role() const override { return Role::kMeasurement; }
  JointRule joint_rule() const override { return JointRule::kNone; }
  std::string bound_text() const override {
    return "2e-4 m: ours, nests repeat to 5 to 40 um, more is a grain of dirt";
  }

  std::vector<std::string> missing(const EffectContext& context,
                                   const std::vector<int>&) const override {
    return missing_set_ups(context, "nest");
  }

  EffectTerms build(const EffectContext& context, const EffectRequest&) const override {
    EffectTerms terms;
    for (const int number : later_set_ups(context, "nest")) {
      for (int c = 0; c < 3; ++c) {
        std::vector<Coordinate> tools;
        for (int t = 0; t < context.targets; ++t) tools.push_back({Place::kTool, t, c});
        terms.parameters.push_back(
            of_set_up(id(), "nest", number, kComponentNames[c], "m", kFurthest, tools));
      }
    }
    return terms;
  }

 private:
  static constexpr double kFurthest = 2e-4;  // [m]
};

const RegisterEffect<Nest> registered_nest;

}  // namespace
}  // namespace armtrue
