#include "fitter/effects/instrument/set_ups.h"

#include <cmath>
#include <set>

namespace armtrue {
namespace {

// The set-ups whose displacement is fitted: all numbers in `column` except the lowest, whose set-up
// the others are displaced from. Empty if the column holds a number that is not an integer.
std::set<int> later_set_ups(const EffectContext& context, const std::string& column) {
  std::set<int> numbers;
  for (const double v : context.state.column(column)) {
    if (v != std::round(v)) return {};
    numbers.insert(static_cast<int>(v));
  }
  if (!numbers.empty()) numbers.erase(numbers.begin());
  return numbers;
}

}  // namespace

std::vector<std::string> SetUpEffect::missing(const EffectContext& context,
                                              const std::vector<int>&) const {
  if (!context.state.recorded(id())) return {id()};
  if (later_set_ups(context, id()).empty())
    return {"whole numbers of two set-ups in column " + id()};
  return {};
}

EffectTerms SetUpEffect::build(const EffectContext& context, const EffectRequest&) const {
  EffectTerms terms;
  for (const int number : later_set_ups(context, id())) {
    const auto at = [&](int offset) { return std::to_string(number + offset); };
    const std::string is_this = "hat(" + id() + ", " + at(-1) + ", " + at(0) + ", " + at(1) + ")";
    for (const Places& p : places(context)) {
      Parameter& shift = add(terms, {}, at(0) + "_" + p.component, p.unit, p.bound,
                             p.coordinates.front(), is_this);
      shift.terms.resize(p.coordinates.size(), Term(shift.terms.front()));
      for (std::size_t i = 0; i < p.coordinates.size(); ++i)
        shift.terms[i].coordinate = p.coordinates[i];
    }
  }
  return terms;
}

}  // namespace armtrue
