#include "fitter/effects/tables.h"

namespace armtrue {
namespace {

class AxisStraightness final : public Effect {
 public:
  AxisStraightness()
      : Effect({.id = "axis_straightness",
                .summary = "a rail or slide is not straight",
                .bound =
                    "3e-4 m and 5e-4 rad: ours, rails are laid to 20 to 60 um and 10 to 30 arcsec",
                .drives = DriveRule::kEach,
                .motion = Motion::kSliding}) {}

  // Errors along the rail, its own z, are position errors and no crookedness. Where the rail
  // begins, its orientation there and where it ends are geometry, so shifts count from the line
  // through both ends, and turns from the first end (ISO 230-1). Fitted beside geometry, they would
  // be determined by their priors alone.
  EffectTerms build(const EffectContext& context, const EffectRequest& request) const override {
    EffectTerms terms;
    for (const int k : request.joints) {
      const std::string q = "q" + std::to_string(k);
      const std::vector<double> nodes = nodes_over(context.state.column(q), 1e9, kNodes);
      for (const int c : {0, 1, 3, 4, 5}) {
        const std::size_t last = c < 3 ? nodes.size() - 1 : nodes.size();
        for (std::size_t i = 1; i < last; ++i) {
          add(terms, {k}, kComponentNames[c] + ("_" + std::to_string(i + 1)), c < 3 ? "m" : "rad",
              c < 3 ? kFurthest : kLargest, on_link(k, c), hat_expression(q, nodes, i))
              .prior_sigma = c < 3 ? kFurthest : kLargest;
        }
      }
    }
    return terms;
  }

 private:
  static constexpr std::size_t kNodes = 6;
  static constexpr double kFurthest = 3e-4;  // [m]
  static constexpr double kLargest = 5e-4;   // [rad]
};

const RegisterEffect<AxisStraightness> registered_axis_straightness;

}  // namespace
}  // namespace armtrue
