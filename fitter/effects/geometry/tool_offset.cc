#include "fitter/effects/effect.h"

namespace armtrue {
namespace {

class ToolOffset final : public Effect {
 public:
  std::string id() const override { return "tool_offset"; }
  std::string summary() const override {
    return "reflector (SMR) or TCP in the flange, each target its own";
  }
  Role role() const override { return Role::kPlacement; }
  JointRule joint_rule() const override { return JointRule::kNone; }
  std::string bound_text() const override { return "none: the reflector may sit anywhere"; }

  EffectTerms build(const EffectContext& context, const EffectRequest&) const override {
    EffectTerms terms;
    for (int t = 0; t < context.targets; ++t) {
      for (int c = 0; c < (context.has_rotation(t) ? 6 : 3); ++c) {
        const std::string suffix =
            (context.targets > 1 ? "target" + std::to_string(t) + "_" : "") + kComponentNames[c];
        Parameter p = single_term(id(), {}, suffix, c < 3 ? "m" : "rad", 0.0,
                                  Coordinate{Place::kTool, t, c}, "1");
        p.exported = false;
        terms.parameters.push_back(p);
      }
    }
    return terms;
  }
};

const RegisterEffect<ToolOffset> registered_tool_offset;

}  // namespace
}  // namespace armtrue
