#include "fitter/effects/instrument/set_ups.h"

namespace armtrue {
namespace {

class Station final : public SetUpEffect {
 public:
  Station()
      : SetUpEffect({.id = "station",
                     .summary =
                         "several set-ups of the tracker: each one's frame is a little beside "
                         "the first one's",
                     .bound = "3 mm and 2 mrad: ours, to which the nominal arm itself ties set-ups "
                              "together; nests do better",
                     .role = Role::kMeasurement,
                     .joints = JointRule::kNone}) {}

  std::vector<Places> places(const EffectContext&) const override {
    std::vector<Places> result;
    for (int c = 0; c < 6; ++c) {
      result.push_back(
          {kComponentNames[c], c < 3 ? "m" : "rad", c < 3 ? kFurthest : kLargest, {on_base(c)}});
    }
    return result;
  }

 private:
  static constexpr double kFurthest = 3e-3;  // [m]
  static constexpr double kLargest = 2e-3;   // [rad]
};

const RegisterEffect<Station> registered_station;

}  // namespace
}  // namespace armtrue
