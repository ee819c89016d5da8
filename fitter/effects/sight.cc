#include "fitter/effects/sight.h"

namespace armtrue {

Sight line_of_sight(const EffectContext& context) {
  const auto from = [&](const char* name, Eigen::Index axis) {
    return "(" + std::string(name) + " - (" +
           Expression::number(context.instrument[axis]).to_string() + "))";
  };
  Sight s{from("x", 0), from("y", 1), from("z", 2), "", ""};
  const std::string level = s.x + "^2 + " + s.y + "^2";
  s.across = "sqrt(" + level + ")";
  s.distance = "sqrt(" + level + " + " + s.z + "^2)";
  return s;
}

// The base's virtual joint moves along the axes of the robot's base.
Parameter shift_of_point(const EffectContext& context, const std::string& effect,
                         const std::string& suffix, const std::string& unit, double bound,
                         const std::array<std::string, 3>& shift) {
  Parameter p;
  for (int c = 0; c < 3; ++c) {
    std::string text;
    for (int axis = 0; axis < 3; ++axis) {
      const auto i = static_cast<std::size_t>(axis);
      if (shift[i].empty()) continue;
      text += (text.empty() ? "(" : " + (") +
              Expression::number(context.measuring_from_base(axis, c)).to_string() + ")*" +
              shift[i];
    }
    Parameter one = single_term(effect, {}, suffix, unit, bound, on_base(c), text);
    if (c == 0) {
      p = one;
    } else {
      p.terms.push_back(one.terms.front());
    }
  }
  p.exported = false;
  return p;
}

}  // namespace armtrue
