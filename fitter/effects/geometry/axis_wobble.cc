#include "fitter/effects/effect.h"

namespace armtrue {
namespace {

class AxisWobble final : public Effect {
 public:
  std::string id() const override { return "axis_wobble"; }
  std::string summary() const override { return "bearing runs out: the axis tilts as it turns"; }
  JointRule joint_rule() const override { return JointRule::kEach; }
  std::string bound_text() const override {
    return "3e-4 rad and 1e-4 m: ours, ten times what new bearings of robots run out";
  }

  std::vector<int> default_joints(const EffectContext& context) const override {
    std::vector<int> joints;
    for (int k = 1; k <= context.joint_count(); ++k) {
      if (!context.prismatic(k)) joints.push_back(k);
    }
    return joints;
  }

  std::vector<std::string> missing(const EffectContext& context,
                                   const std::vector<int>& joints) const override {
    std::vector<std::string> lacking;
    for (const int k : joints) {
      if (context.prismatic(k)) lacking.push_back("a revolute joint " + std::to_string(k));
    }
    return lacking;
  }

  // A motion that turns once with the angle, x by cos and y by sin (or x by sin and y by -cos), is
  // one coefficient. In this frame, which turns itself, the opposite sense is a constant tilt or
  // shift, which is part of link_geometry.
  EffectTerms build(const EffectContext&, const EffectRequest& request) const override {
    EffectTerms terms;
    for (const int k : request.joints) {
      const std::string th = "th" + std::to_string(k);
      for (const bool tilt : {true, false}) {
        const int x = tilt ? 3 : 0;
        const std::string unit = tilt ? "rad" : "m";
        const double bound = tilt ? kLargest : kFurthest;
        for (const bool cosine : {true, false}) {
          Parameter& turning = terms.parameters.emplace_back(single_term(
              id(), {k}, (tilt ? "rxy_" : "txy_") + std::string(cosine ? "cos1" : "sin1"), unit,
              bound, on_link(k, x), (cosine ? "cos(" : "sin(") + th + ")"));
          turning.terms.push_back(Term{on_link(k, x + 1),
                                       Expression::parse((cosine ? "sin(" : "cos(") + th + ")"),
                                       cosine ? 1.0 : -1.0, std::nullopt});
        }
        for (const int c : {x, x + 1}) {
          for (const std::string wave : {"sin", "cos"}) {
            terms.parameters.push_back(
                single_term(id(), {k}, std::string(kComponentNames[c]) + "_" + wave + "2", unit,
                            bound, on_link(k, c), wave + "(2*" + th + ")"));
          }
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
  static constexpr double kLargest = 3e-4;   // [rad]
  static constexpr double kFurthest = 1e-4;  // [m]
};

const RegisterEffect<AxisWobble> registered_axis_wobble;

}  // namespace
}  // namespace armtrue
