#include "fitter/effects/tables.h"

namespace armtrue {
namespace {

class AxisStraightness final : public Effect {
 public:
  std::string id() const override { return "axis_straightness"; }
  std::string summary() const override { return "a rail or slide is not straight"; }
  JointRule joint_rule() const override { return JointRule::kEach; }
  DriveRule drive_rule() const override { return DriveRule::kEach; }
  std::string bound_text() const override {
    return "3e-4 m and 5e-4 rad: ours, rails are laid to 20 to 60 um and 10 to 30 arcsec";
  }

  std::vector<int> default_joints(const EffectContext& context) const override {
    std::vector<int> joints;
    for (int k = 1; k <= context.joint_count(); ++k) {
      if (context.prismatic(k)) joints.push_back(k);
    }
    return joints;
  }

  std::vector<std::string> missing(const EffectContext& context,
                                   const std::vector<int>& joints) const override {
    std::vector<std::string> lacking;
    if (joints.empty()) lacking.emplace_back("a joint that slides");
    for (const int k : joints) {
      if (!context.prismatic(k)) lacking.push_back("joint " + std::to_string(k) + " that slides");
    }
    return lacking;
  }

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
          terms.parameters.push_back(single_term(
              id(), {k}, kComponentNames[c] + ("_" + std::to_string(i + 1)), c < 3 ? "m" : "rad",
              c < 3 ? kFurthest : kLargest, on_link(k, c), hat_expression(q, nodes, i)));
          terms.parameters.back().prior_sigma = c < 3 ? kFurthest : kLargest;
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
  static constexpr std::size_t kNodes = 6;
  static constexpr double kFurthest = 3e-4;  // [m]
  static constexpr double kLargest = 5e-4;   // [rad]
};

const RegisterEffect<AxisStraightness> registered_axis_straightness;

}  // namespace
}  // namespace armtrue
