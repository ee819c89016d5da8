#include <algorithm>
#include <cstdio>
#include <numbers>

#include "fitter/effects/effect.h"

namespace armtrue {
namespace {

// A wave over a joint: its label, and its cycles per turn, or, for a joint that slides, its
// wavelength [m].
struct Wave {
  std::string label;
  double period;
};

class GearMesh final : public Effect {
 public:
  GearMesh()
      : Effect({.id = "gear_mesh",
                .summary = "errors once or twice per turn of a motor, screw or pinion, or of a "
                           "stage in between",
                .bound = "2.5e-3 rad: 5 to 40 arcsec usual, strain-wave gears up to 1 arcmin; of a "
                         "joint that slides 5e-4 m: ball screws of ISO 3408 wobble by 3 to 10 um a "
                         "turn, worn or bent ones and pinions off their centre by 100 um",
                .drives = DriveRule::kEach,
                .options =
                    {{"orders", "[number]",
                      "cycles per motor turn (where the joint slides: per turn of its screw or "
                      "pinion), default [1]"},
                     {"ratio", "number",
                      "motor turns per joint turn, default robot.yaml's gear_ratio"},
                     {"cycles", "[number]", "cycles per joint turn, in place of orders and ratio"},
                     {"lead", "m",
                      "of a joint that slides: travel per turn of its screw or pinion, default "
                      "robot.yaml's lead"},
                     {"wavelengths", "[m]",
                      "of a joint that slides: lengths of the waves, in place of orders and lead"},
                     {"find", "bool",
                      "fine-tune cycles or wavelengths to the data, starting from these"}},
                .told_apart = {"orders", "cycles", "wavelengths"}}) {}

  std::vector<int> default_joints(const EffectContext& context) const override {
    std::vector<int> joints;
    for (int k = 1; k <= context.joint_count(); ++k) {
      if (turn_of(context, k) > 0.0) joints.push_back(k);
    }
    return joints;
  }

  std::optional<EffectRequest> as_line(const EffectContext& context, int joint,
                                       double cycles) const override {
    if (context.prismatic(joint))
      return EffectRequest{id(), {joint}, {{"wavelengths", {1.0 / cycles}}}};
    return EffectRequest{id(), {joint}, {{"cycles", {cycles}}}};
  }

  std::vector<double> lines(const EffectContext& context,
                            const EffectRequest& request) const override {
    std::vector<double> result;
    const int joint = request.joints.front();
    for (const Wave& wave : waves_of(context, request, joint))
      result.push_back(context.prismatic(joint) ? 1.0 / wave.period : wave.period);
    return result;
  }

  std::vector<double> tried_lines(const EffectContext& context, int joint) const override {
    if (turn_of(context, joint) <= 0.0) return {};
    return lines(context, {id(), {joint}, {{"orders", known_orders(context, joint)}}});
  }

  EffectTerms build(const EffectContext& context, const EffectRequest& request) const override {
    EffectTerms terms;
    for (const int k : request.joints) {
      const std::vector<Wave> waves = waves_of(context, request, k);
      const bool slides = context.prismatic(k);
      const std::string q = "q" + std::to_string(k);
      for (std::size_t i = 0; i < waves.size(); ++i) {
        std::string period = Expression::number(waves[i].period).to_string();
        if (request.options.value("find", false)) {
          period = std::string(slides ? "gear_mesh_wavelength_" : "gear_mesh_cycles_") +
                   std::to_string(k) + "_" + std::to_string(i + 1);
          terms.nonlinear.push_back(search_near(context, k, waves[i].period, period));
        }
        const std::string angle = slides ? "2*pi*" + q + "/" + period : period + "*" + q;
        for (const std::string wave : {"sin", "cos"}) {
          add(terms, {k}, wave + waves[i].label, motor_unit(context, k),
              on_motor(context, k, kLargest, kLargestOfASlide), motor(k), wave + "(" + angle + ")");
        }
      }
    }
    return terms;
  }

  std::vector<EffectRequest> candidates(const EffectContext& context) const override {
    std::vector<EffectRequest> result;
    for (const int k : default_joints(context)) {
      for (const double order : known_orders(context, k))
        result.push_back({id(), {k}, {{"orders", {order}}}});
    }
    return result;
  }

 private:
  static constexpr double kLargest = 2.5e-3;        // [rad]
  static constexpr double kLargestOfASlide = 5e-4;  // [m]

  // Motor turns per joint turn, or travel per turn of the screw or pinion [m]; 0 if unknown.
  static double turn_of(const EffectContext& context, int k) {
    const Joint& joint = context.robot().joints[static_cast<std::size_t>(k - 1)];
    return joint.prismatic ? joint.lead : joint.gear_ratio;
  }

  static std::vector<double> known_orders(const EffectContext& context, int k) {
    if (context.prismatic(k)) return {1.0, 2.0};
    return {1.0, 2.0, 0.5, 4.0};
  }

  static std::string millimetres(double length) {
    char text[32];
    std::snprintf(text, sizeof text, "%.6gmm", 1e3 * length);
    return text;
  }

  static void refuse_options_of_other_joints(const EffectRequest& request, int k, bool slides) {
    const auto refuse = [&](const char* option, const char* moves, const char* expected) {
      if (request.options.contains(option))
        throw ModelError("effect gear_mesh: found " + std::string(option) + " for joint " +
                         std::to_string(k) + ", which " + moves + ", expected " + expected);
    };
    if (slides) {
      refuse("cycles", "slides", "wavelengths in metres");
      refuse("ratio", "slides", "lead, the travel per turn of its screw or pinion in metres");
    } else {
      refuse("wavelengths", "turns", "cycles per joint turn");
      refuse("lead", "turns", "ratio, the motor's turns per joint turn");
    }
  }

  static std::vector<Wave> waves_of(const EffectContext& context, const EffectRequest& request,
                                    int k) {
    const bool slides = context.prismatic(k);
    refuse_options_of_other_joints(request, k, slides);
    const nlohmann::json& options = request.options;
    std::vector<Wave> waves;
    for (const double length : options.value("wavelengths", std::vector<double>{}))
      waves.push_back({millimetres(length), length});
    for (const double cycles : options.value("cycles", std::vector<double>{}))
      waves.push_back({Expression::number(cycles).to_string() + "c", cycles});
    for (const Wave& wave : waves) {
      if (!(wave.period > 0.0))
        throw ModelError("effect gear_mesh: cycles and wavelengths must be above 0");
    }
    if (options.contains("cycles") || options.contains("wavelengths")) return waves;
    const double turn = options.value(slides ? "lead" : "ratio", turn_of(context, k));
    if (!(turn > 0.0)) {
      throw ModelError("effect gear_mesh: joint " + std::to_string(k) + " has no " +
                       (slides ? "lead" : "gear_ratio") + " in robot.yaml; give it there, or " +
                       (slides ? "lead or wavelengths" : "ratio or cycles") + " in model.yaml");
    }
    for (const double order : options.value("orders", std::vector<double>{1.0}))
      waves.push_back(
          {Expression::number(order).to_string(), slides ? turn / order : turn * order});
    return waves;
  }

  // The period as a nonlinear parameter, free by half a wave per turn, or over the joint's travel.
  NonlinearParameter search_near(const EffectContext& context, int k, double period,
                                 const std::string& name) const {
    if (!context.prismatic(k))
      return {name, id(), {k}, "1/turn", period, period - 0.5, period + 0.5, {}};
    const auto [low, high] = std::ranges::minmax(context.state.column("q" + std::to_string(k)));
    const double half = high > low ? std::min(0.5 / (high - low), 0.5 / period) : 0.5 / period;
    const double least = 1.0 / (1.0 / period + half), most = 1.0 / (1.0 / period - half);
    return {name, id(), {k}, "m", period, least, most, {}};
  }
};

const RegisterEffect<GearMesh> registered_gear_mesh;

}  // namespace
}  // namespace armtrue
