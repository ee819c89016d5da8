#include "fitter/effects/instrument/set_ups.h"

namespace armtrue {
namespace {

class Nest final : public SetUpEffect {
 public:
  Nest()
      : SetUpEffect({.id = "nest",
                     .summary = "a reflector that was taken out sits elsewhere when it is put back",
                     .bound = "2e-4 m: ours, nests repeat to 5 to 40 um, more is a grain of dirt",
                     .role = Role::kMeasurement,
                     .joints = JointRule::kNone}) {}

  std::vector<Places> places(const EffectContext& context) const override {
    std::vector<Places> result;
    for (int c = 0; c < 3; ++c) {
      result.push_back({kComponentNames[c], "m", kFurthest, {}});
      for (int t = 0; t < context.targets; ++t)
        result.back().coordinates.push_back({Place::kTool, t, c});
    }
    return result;
  }

 private:
  static constexpr double kFurthest = 2e-4;  // [m]
};

const RegisterEffect<Nest> registered_nest;

}  // namespace
}  // namespace armtrue
