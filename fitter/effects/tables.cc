#include "fitter/effects/tables.h"

#include <algorithm>
#include <cmath>

namespace armtrue {

std::string hat_expression(const std::string& variable, const std::vector<double>& nodes,
                           std::size_t index) {
  const auto text = [](double v) { return Expression::number(v).to_string(); };
  const double centre = nodes[index];
  const std::size_t last = nodes.size() - 1;
  if (last == 0) return "1";
  const double left = index == 0 ? centre - (nodes[1] - centre) : nodes[index - 1];
  const double right = index == last ? centre + (centre - nodes[last - 1]) : nodes[index + 1];
  return "hat(" + variable + ", " + text(left) + ", " + text(centre) + ", " + text(right) + ")";
}

std::vector<double> nodes_over(const std::vector<double>& values, double spacing,
                               std::size_t least) {
  const auto [low, high] = std::minmax_element(values.begin(), values.end());
  const double range = *high - *low;
  if (!(range > 0.0)) return {*low};
  const auto cells =
      std::max<std::size_t>(least - 1, static_cast<std::size_t>(std::ceil(range / spacing - 1e-9)));
  std::vector<double> nodes;
  for (std::size_t i = 0; i <= cells; ++i)
    nodes.push_back(*low + range * static_cast<double>(i) / static_cast<double>(cells));
  return nodes;
}

Penalty curvature_penalty(const std::string& before, const std::string& at,
                          const std::string& after) {
  return {{{before, 1.0}, {at, -2.0}, {after, 1.0}}, 1.0, true, ""};
}

Penalty value_penalty(const std::string& parameter, double sigma) {
  return {{{parameter, 1.0}}, sigma, true, ""};
}

}  // namespace armtrue
