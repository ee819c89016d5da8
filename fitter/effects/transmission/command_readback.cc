#include "fitter/effects/effect.h"

namespace armtrue {
namespace {

class CommandReadback final : public Effect {
 public:
  CommandReadback()
      : Effect({.id = "command_readback",
                .summary = "joints recorded before the arm had settled",
                .bound = "-2 to 2 rad/rad: a full exchange of command and read-back is -1",
                .role = Role::kMeasurement,
                .drives = DriveRule::kEach,
                .joint_columns = {"qr"}}) {}

  EffectTerms build(const EffectContext&, const EffectRequest& request) const override {
    EffectTerms terms;
    for (const int k : request.joints) {
      const std::string joint = std::to_string(k);
      add(terms, {k}, "", "rad/rad", 2.0, motor(k), "q" + joint + " - qr" + joint);
    }
    return terms;
  }

  std::vector<EffectRequest> candidates(const EffectContext& context) const override {
    std::vector<EffectRequest> result = Effect::candidates(context);
    result.push_back({id(), default_joints(context)});
    return result;
  }
};

const RegisterEffect<CommandReadback> registered_command_readback;

}  // namespace
}  // namespace armtrue
