#include "fitter/effects/instrument/set_ups.h"

namespace armtrue {
namespace {

class Station final : public Effect {
 public:
  std::string id() const override { return "station"; }
  std::string summary() const override {
    return "several set-ups of the tracker: each one's frame is a little beside the first one's";
  }
  Role role() const override { return Role::kMeasurement; }
  JointRule joint_rule() const override { return JointRule::kNone; }
  std::string bound_text() const override {
    return "3 mm and 2 mrad: ours, to which the nominal arm itself ties set-ups together; nests do "
           "better";
  }

  std::vector<std::string> missing(const EffectContext& context,
                                   const std::vector<int>&) const override {
    return missing_set_ups(context, "station");
  }

  EffectTerms build(const EffectContext& context, const EffectRequest&) const override {
    EffectTerms terms;
    for (const int number : later_set_ups(context, "station")) {
      for (int c = 0; c < 6; ++c) {
        terms.parameters.push_back(of_set_up(id(), "station", number, kComponentNames[c],
                                             c < 3 ? "m" : "rad", c < 3 ? kFurthest : kLargest,
                                             {on_base(c)}));
      }
    }
    return terms;
  }

 private:
  static constexpr double kFurthest = 3e-3;  // [m]
  static constexpr double kLargest = 2e-3;   // [rad]
};

const RegisterEffect<Station> registered_station;

}  // namespace
}  // namespace armtrue
