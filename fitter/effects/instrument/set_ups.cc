#include "fitter/effects/instrument/set_ups.h"

#include <cmath>
#include <set>

namespace armtrue {

std::vector<int> later_set_ups(const EffectContext& context, const std::string& column) {
  std::set<int> numbers;
  for (const double v : context.state.column(column)) {
    if (v != std::round(v)) return {};
    numbers.insert(static_cast<int>(v));
  }
  if (!numbers.empty()) numbers.erase(numbers.begin());
  return {numbers.begin(), numbers.end()};
}

std::vector<std::string> missing_set_ups(const EffectContext& context, const std::string& column) {
  if (!context.state.recorded(column)) return {column};
  if (later_set_ups(context, column).empty())
    return {"whole numbers of two set-ups in column " + column};
  return {};
}

Parameter of_set_up(const std::string& effect, const std::string& column, int number,
                    const std::string& component, const std::string& unit, double bound,
                    const std::vector<Coordinate>& places) {
  const auto at = [&](int offset) { return std::to_string(number + offset); };
  Parameter p = single_term(effect, {}, at(0) + "_" + component, unit, bound, places.front(),
                            "hat(" + column + ", " + at(-1) + ", " + at(0) + ", " + at(1) + ")");
  for (std::size_t i = 1; i < places.size(); ++i) {
    Term term = p.terms.front();
    term.coordinate = places[i];
    p.terms.push_back(term);
  }
  p.exported = false;
  return p;
}

}  // namespace armtrue
