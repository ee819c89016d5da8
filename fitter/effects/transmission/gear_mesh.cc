#include "fitter/effects/effect.h"

namespace armtrue {
namespace {

class GearMesh final : public Effect {
 public:
  std::string id() const override { return "gear_mesh"; }
  std::string summary() const override {
    return "errors once or twice per motor turn, or of a stage in between";
  }
  JointRule joint_rule() const override { return JointRule::kEach; }
  DriveRule drive_rule() const override { return DriveRule::kEach; }
  std::string bound_text() const override {
    return "2.5e-3 rad: 5 to 40 arcsec usual, strain-wave gears up to 1 arcmin";
  }

  std::vector<EffectOption> options() const override {
    return {{"orders", "[number]", "cycles per motor turn, default [1]"},
            {"ratio", "number", "motor turns per joint turn, default robot.yaml's gear_ratio"},
            {"cycles", "[number]", "cycles per joint turn, in place of orders and ratio"},
            {"find", "bool", "fine-tune the cycles to the data, starting from these"}};
  }

  std::vector<std::string> missing(const EffectContext& context,
                                   const std::vector<int>& joints) const override {
    std::vector<std::string> lacking;
    for (const int k : joints) {
      if (context.prismatic(k)) lacking.push_back("a revolute joint " + std::to_string(k));
    }
    return lacking;
  }

  std::vector<int> default_joints(const EffectContext& context) const override {
    std::vector<int> joints;
    for (int k = 1; k <= context.joint_count(); ++k) {
      if (!context.prismatic(k) && ratio_of(context, k) > 0.0) joints.push_back(k);
    }
    return joints;
  }

  std::optional<EffectRequest> as_line(int joint, double cycles) const override {
    return EffectRequest{id(), {joint}, {{"cycles", {cycles}}}};
  }

  EffectTerms build(const EffectContext& context, const EffectRequest& request) const override {
    EffectTerms terms;
    for (const int k : request.joints) {
      std::vector<double> cycles;
      std::vector<std::string> labels;
      if (request.options.contains("cycles")) {
        cycles = request.options["cycles"].get<std::vector<double>>();
        for (const double c : cycles) labels.push_back(Expression::number(c).to_string() + "c");
      } else {
        const double ratio = request.options.value("ratio", ratio_of(context, k));
        if (!(ratio > 0.0)) {
          throw ModelError(
              "effect gear_mesh: joint " + std::to_string(k) +
              " has no gear_ratio in robot.yaml; give it there, or ratio or cycles in model.yaml");
        }
        for (const double order : request.options.value("orders", std::vector<double>{1.0})) {
          cycles.push_back(order * ratio);
          labels.push_back(Expression::number(order).to_string());
        }
      }
      const bool find = request.options.value("find", false);
      for (std::size_t i = 0; i < cycles.size(); ++i) {
        std::string frequency = Expression::number(cycles[i]).to_string();
        if (find) {
          frequency = "gear_mesh_cycles_" + std::to_string(k) + "_" + std::to_string(i + 1);
          terms.nonlinear.push_back(
              {frequency, id(), {k}, "1/turn", cycles[i], cycles[i] - 0.5, cycles[i] + 0.5, {}});
        }
        for (const std::string wave : {"sin", "cos"}) {
          terms.parameters.push_back(
              single_term(id(), {k}, wave + labels[i], "rad", kLargest, motor(k),
                          wave + "(" + frequency + "*q" + std::to_string(k) + ")"));
        }
      }
    }
    return terms;
  }

  std::vector<EffectRequest> candidates(const EffectContext& context) const override {
    std::vector<EffectRequest> result;
    for (const int k : default_joints(context)) {
      for (const double order : {1.0, 2.0, 0.5, 4.0})
        result.push_back({id(), {k}, {{"orders", {order}}}});
    }
    return result;
  }

 private:
  static constexpr double kLargest = 2.5e-3;  // [rad]

  static double ratio_of(const EffectContext& context, int joint) {
    return context.robot().joints[static_cast<std::size_t>(joint - 1)].gear_ratio;
  }
};

const RegisterEffect<GearMesh> registered_gear_mesh;

}  // namespace
}  // namespace armtrue
