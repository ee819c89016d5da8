#include "fitter/design/carried_load.h"

#include <algorithm>

namespace armtrue {

CarriedLoads::CarriedLoads(const Model& model, const CoordinateLayout& layout, const State& state)
    : load_of_(model.parameters.size(), -1), follows_(model.parameters.size(), false) {
  std::vector<std::string> names;
  for (std::size_t p = 0; p < model.parameters.size(); ++p) {
    for (const Term& term : model.parameters[p].terms) {
      if (!term.follows) continue;
      const auto found = std::ranges::find(names, term.follows->load);
      const auto load = static_cast<std::size_t>(found - names.begin());
      if (found == names.end()) names.push_back(term.follows->load);
      std::vector<double> ratio = state.values(term.follows->ratio);
      for (double& r : ratio) r *= term.weight;
      followers_.push_back({p, load, layout.index(term.coordinate), std::move(ratio)});
      follows_[p] = true;
    }
  }
  loads_ = names.size();
  for (std::size_t p = 0; loads_ > 0 && p < model.parameters.size(); ++p) {
    const auto carried = find_effect(model.parameters[p].effect).carries();
    if (!carried) continue;
    const auto found = std::ranges::find(names, carried->torque);
    if (found != names.end()) load_of_[p] = static_cast<int>(found - names.begin());
  }
}

}  // namespace armtrue
