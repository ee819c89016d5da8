#include "fitter/diagnose/line_advice.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <iterator>
#include <numbers>

#include "fitter/evidence/words.h"

namespace armtrue {
namespace {

// Shafts and stages of a gear make p/q waves per motor turn, with p and q no larger than these.
constexpr int kLargestNumerator = 8, kLargestDenominator = 4;
// Counts that differ by less than this share are printed alike.
constexpr double kSameCount = 1e-5;

// "13 cycles a turn"; for a joint that slides, "waves of 20 mm" from cycles per metre.
std::string line_words(bool slides, double cycles) {
  char text[48];
  std::snprintf(text, sizeof text, slides ? "waves of %.6g mm" : "%.6g cycles a turn",
                slides ? 1e3 / cycles : cycles);
  return text;
}

// "20 cycles a turn and 52 cycles a turn"; empty for no numbers.
std::string lines_words(bool slides, const std::vector<double>& cycles) {
  std::string list;
  for (const double line : cycles) list += (list.empty() ? "" : " and ") + line_words(slides, line);
  return list;
}

// A simple order p/q that the joint's travel cannot distinguish from a line.
struct Order {
  double numerator = 0.0;  // 0: none
  int denominator = 1;
  double value() const { return numerator / denominator; }
  std::string words() const {
    return number_words(numerator) + (denominator > 1 ? "/" + std::to_string(denominator) : "");
  }
};

Order simple_order(double cycles, double turns, double resolution) {
  for (int q = 1; q <= kLargestDenominator; ++q) {
    const Order order{std::round(cycles / turns * q), q};
    if (order.numerator >= 1.0 && order.numerator <= kLargestNumerator &&
        std::abs(cycles - order.value() * turns) < 0.5 * resolution)
      return order;
  }
  return {};
}

// The relation of a rotary joint's line to the turns of its motor.
std::string motor_words(double cycles, double turns, double resolution) {
  const Order order = simple_order(cycles, turns, resolution);
  const std::string line = line_words(false, cycles);
  char text[320];
  if (order.numerator == 0.0) {
    std::snprintf(
        text, sizeof text,
        "%s is %.3g times the motor's %.6g turns per joint turn, no multiple or simple "
        "fraction: a wheel or bearing inside the gear may have this rate, or several lines "
        "are closer together than the %.2g cycles that the joint's travel resolves",
        line.c_str(), cycles / turns, turns, resolution);
  } else if (std::abs(cycles - order.value() * turns) < kSameCount * cycles) {
    std::snprintf(text, sizeof text, "%s is %s times the motor's %.6g turns per joint turn",
                  line.c_str(), order.words().c_str(), turns);
  } else {
    std::snprintf(text, sizeof text,
                  "%s is %s times the motor's turns per joint turn if gear_ratio is %.6g instead "
                  "of the %.6g in robot.yaml",
                  line.c_str(), order.words().c_str(), cycles / order.value(), turns);
  }
  return text;
}

std::string grid_words(const JointSpectrum& spectrum, double cycles) {
  const std::string others = lines_words(spectrum.slides, spectrum.aliases(cycles));
  if (others.empty()) return "";
  const double grid =
      spectrum.slides ? 1e3 * spectrum.grid : spectrum.grid * 180.0 / std::numbers::pi;
  return "all values of q" + std::to_string(spectrum.joint) + " are on a grid of " +
         number_words(grid) + (spectrum.slides ? " mm" : " deg") + ", on which " + others +
         " look the same as " + line_words(spectrum.slides, cycles) +
         " (aliasing): measure poses between the grid values";
}

}  // namespace

std::vector<std::string> line_advice(const EffectRequest& request,
                                     const std::vector<JointSpectrum>& spectra,
                                     const EffectContext& context) {
  const Effect& effect = find_effect(request.effect);
  const std::vector<double> lines = effect.lines(context, request);
  if (lines.empty()) return {};
  const int joint = request.joints.front();
  const bool slides = context.prismatic(joint);
  const double turns = context.robot().joints[static_cast<std::size_t>(joint - 1)].gear_ratio;
  const auto spectrum = std::ranges::find(spectra, joint, &JointSpectrum::joint);
  const std::vector<double> known = effect.tried_lines(context, joint);
  std::vector<std::string> advice, by_motor;
  std::vector<double> unknown;
  for (const double line : lines) {
    const bool is_known = std::ranges::any_of(
        known, [&](double other) { return std::abs(line - other) < kSameCount * other; });
    if (!is_known) unknown.push_back(line);
    if (spectrum == spectra.end()) continue;
    if (std::string words = grid_words(*spectrum, line); !words.empty())
      advice.push_back(std::move(words));
    if (!is_known && !slides && turns > 0.0)
      by_motor.push_back(motor_words(line, turns, spectrum->resolution));
  }
  if (unknown.empty()) return advice;
  advice.push_back(lines_words(slides, unknown) + " on joint " + std::to_string(joint) +
                   (slides ? ": look for a screw or pinion with this travel per turn"
                           : ": look for a gear or bearing with this number of cycles per turn"));
  std::ranges::move(by_motor, std::back_inserter(advice));
  return advice;
}

}  // namespace armtrue
