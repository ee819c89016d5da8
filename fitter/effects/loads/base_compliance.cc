#include "fitter/effects/effect.h"
#include "fitter/effects/loads/gravity_regressors.h"

namespace armtrue {
namespace {

class BaseCompliance final : public Effect {
 public:
  BaseCompliance()
      : Effect({.id = "base_compliance",
                .summary = "foundation tilts under the arm",
                .bound =
                    "0 to 2e-3 rad under the largest moment in the data, at most 1e-4 rad/Nm (1e-5 "
                    "where nobody knows the moments): ours, a stand that tilts more is loose",
                .joints = JointRule::kNone}) {}

  EffectTerms build(const EffectContext& context, const EffectRequest&) const override {
    EffectTerms terms;
    add_tilting(context, *this, 0, {kLargest, kSoftest, kUnknown}, terms);
    return terms;
  }

 private:
  static constexpr double kLargest = 2e-3;  // [rad]
  static constexpr double kSoftest = 1e-4;  // [rad/Nm]
  static constexpr double kUnknown = 1e-5;  // [rad/Nm] if the moments are unknown
};

const RegisterEffect<BaseCompliance> registered_base_compliance;

}  // namespace
}  // namespace armtrue
