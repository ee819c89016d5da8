#include "fitter/effects/effect.h"

namespace armtrue {
namespace {

class AxisWobble final : public Effect {
 public:
  AxisWobble()
      : Effect({.id = "axis_wobble",
                .summary = "bearing runs out: the axis tilts as it turns",
                .bound = "3e-4 rad and 1e-4 m: ours, ten times what new bearings of robots run out",
                .motion = Motion::kTurning}) {}

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
          Parameter& turning =
              add(terms, {k}, (tilt ? "rxy_" : "txy_") + std::string(cosine ? "cos1" : "sin1"),
                  unit, bound, on_link(k, x), (cosine ? "cos(" : "sin(") + th + ")");
          turning.terms.push_back(Term{on_link(k, x + 1),
                                       Expression::parse((cosine ? "sin(" : "cos(") + th + ")"),
                                       cosine ? 1.0 : -1.0});
        }
        for (const int c : {x, x + 1}) {
          for (const std::string wave : {"sin", "cos"}) {
            add(terms, {k}, std::string(kComponentNames[c]) + "_" + wave + "2", unit, bound,
                on_link(k, c), wave + "(2*" + th + ")");
          }
        }
      }
    }
    return terms;
  }

 private:
  static constexpr double kLargest = 3e-4;   // [rad]
  static constexpr double kFurthest = 1e-4;  // [m]
};

const RegisterEffect<AxisWobble> registered_axis_wobble;

}  // namespace
}  // namespace armtrue
