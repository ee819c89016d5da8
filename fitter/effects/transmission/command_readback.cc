#include "fitter/effects/effect.h"

namespace armtrue {
namespace {

class CommandReadback final : public Effect {
 public:
  std::string id() const override { return "command_readback"; }
  std::string summary() const override { return "joints recorded before the arm had settled"; }
  Role role() const override { return Role::kMeasurement; }
  JointRule joint_rule() const override { return JointRule::kEach; }
  DriveRule drive_rule() const override { return DriveRule::kEach; }
  std::string bound_text() const override {
    return "-2 to 2 rad/rad: a full exchange of command and read-back is -1";
  }

  std::vector<std::string> missing(const EffectContext& context,
                                   const std::vector<int>& joints) const override {
    std::vector<std::string> lacking;
    for (const int k : joints) {
      if (!context.state.has("qr" + std::to_string(k))) lacking.push_back("qr" + std::to_string(k));
    }
    return lacking;
  }

  EffectTerms build(const EffectContext&, const EffectRequest& request) const override {
    EffectTerms terms;
    for (const int k : request.joints) {
      const std::string joint = std::to_string(k);
      Parameter p =
          single_term(id(), {k}, "", "rad/rad", 2.0, motor(k), "q" + joint + " - qr" + joint);
      p.exported = false;
      terms.parameters.push_back(p);
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
