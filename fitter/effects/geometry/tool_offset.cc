#include "fitter/effects/effect.h"

namespace armtrue {
namespace {

class ToolOffset final : public Effect {
 public:
  ToolOffset()
      : Effect({.id = "tool_offset",
                .summary = "reflector (SMR) or TCP in the flange, each target its own",
                .bound = "none: the reflector may sit anywhere",
                .role = Role::kPlacement,
                .joints = JointRule::kNone}) {}

  EffectTerms build(const EffectContext& context, const EffectRequest&) const override {
    EffectTerms terms;
    for (int t = 0; t < context.targets; ++t) {
      for (int c = 0; c < (context.has_rotation(t) ? 6 : 3); ++c) {
        const std::string suffix =
            (context.targets > 1 ? "target" + std::to_string(t) + "_" : "") + kComponentNames[c];
        add(terms, {}, suffix, c < 3 ? "m" : "rad", 0.0, {Place::kTool, t, c}, "1");
      }
    }
    return terms;
  }
};

const RegisterEffect<ToolOffset> registered_tool_offset;

}  // namespace
}  // namespace armtrue
