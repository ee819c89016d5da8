#include "fitter/effects/instrument/sight.h"

#include <utility>

#include "fitter/common/dense.h"

namespace armtrue {
namespace {

std::string term(double factor, const std::string& what) {
  return "(" + Expression::number(factor).to_string() + ")*" + what;
}

// Removes what moves all points of the campaign as one rigid body, which belongs to the base frame:
// the data would hardly separate the two, and a prediction, which has only the base, would be far
// off.
std::array<std::string, 3> without_rigid_motion(const EffectContext& context,
                                                const std::array<std::string, 3>& shift) {
  if (!context.state.recorded("x")) return shift;
  const auto rows = static_cast<Eigen::Index>(context.state.rows());
  const auto evaluated = [&](const std::string& text) -> Eigen::VectorXd {
    if (text.empty()) return Eigen::VectorXd::Zero(rows);
    const std::vector<double> values = context.state.values(Expression::parse(text));
    return Eigen::Map<const Eigen::VectorXd>(values.data(), rows);
  };
  const Sight s = line_of_sight(context);
  const Eigen::VectorXd x = evaluated(s.x), y = evaluated(s.y), z = evaluated(s.z);
  Eigen::MatrixXd rigid = Eigen::MatrixXd::Zero(3 * rows, 6);  // translations, then rotations
  Eigen::VectorXd moved(3 * rows);
  for (int axis = 0; axis < 3; ++axis) {
    const auto i = static_cast<std::size_t>(axis);
    rigid.col(axis).segment(axis * rows, rows).setOnes();
    moved.segment(axis * rows, rows) = evaluated(shift[i]);
  }
  rigid.col(3).segment(rows, rows) = -z;
  rigid.col(3).segment(2 * rows, rows) = y;
  rigid.col(4).segment(0, rows) = z;
  rigid.col(4).segment(2 * rows, rows) = -x;
  rigid.col(5).segment(0, rows) = -y;
  rigid.col(5).segment(rows, rows) = x;
  const Eigen::VectorXd motion = least_squares(std::move(rigid), -moved);
  const std::array<std::string, 3> point{s.x, s.y, s.z};
  std::array<std::string, 3> result;
  for (std::size_t a = 0; a < 3; ++a) {
    const std::size_t b = (a + 1) % 3, c = (a + 2) % 3;
    const auto turn = [&](std::size_t axis) { return motion[3 + static_cast<Eigen::Index>(axis)]; };
    result[a] = "(" + (shift[a].empty() ? "0" : shift[a]) + " + (" +
                Expression::number(motion[static_cast<Eigen::Index>(a)]).to_string() + ") + " +
                term(turn(b), point[c]) + " + " + term(-turn(c), point[b]) + ")";
  }
  return result;
}

}  // namespace

Sight line_of_sight(const EffectContext& context) {
  const auto from = [&](const char* name, Eigen::Index axis) {
    return "(" + std::string(name) + " - (" +
           Expression::number(context.instrument[axis]).to_string() + "))";
  };
  Sight s{from("x", 0), from("y", 1), from("z", 2), "", ""};
  // A point at the instrument has no direction: 1 µm, squared, keeps the terms finite.
  const std::string level = s.x + "^2 + " + s.y + "^2 + 1e-12";
  s.across = "sqrt(" + level + ")";
  s.distance = "sqrt(" + level + " + " + s.z + "^2)";
  return s;
}

// The base's virtual joint acts along the axes of the robot base, so the shift is turned into them.
void shift_of_point(const EffectContext& context, const Effect& effect, const std::string& suffix,
                    const std::string& unit, double bound, const std::array<std::string, 3>& given,
                    EffectTerms& terms) {
  const std::array<std::string, 3> shift = without_rigid_motion(context, given);
  Parameter* p = nullptr;
  for (int c = 0; c < 3; ++c) {
    std::string text;
    for (int axis = 0; axis < 3; ++axis) {
      const auto i = static_cast<std::size_t>(axis);
      if (shift[i].empty()) continue;
      text += (text.empty() ? "(" : " + (") +
              Expression::number(context.measuring_from_base(axis, c)).to_string() + ")*" +
              shift[i];
    }
    if (p) {
      p->terms.push_back({on_base(c), Expression::parse(text)});
    } else {
      p = &effect.add(terms, {}, suffix, unit, bound, on_base(c), text);
    }
  }
}

}  // namespace armtrue
