#include "fitter/design/effect_sizes.h"

#include <cmath>
#include <vector>

namespace armtrue {

std::map<std::string, double> effect_sizes(Design& design) {
  std::map<std::string, double> squares;
  std::map<std::string, Eigen::Vector3d> moves;
  Design::Row row;
  std::vector<BasisTable::Entry> entries;
  for (std::size_t i = 0; i < design.rows(); ++i) {
    design.evaluate(i, true, row);
    design.basis().row(i, entries);
    moves.clear();
    for (const BasisTable::Entry& entry : entries) {
      const auto parameter = static_cast<std::size_t>(entry.parameter);
      auto& sum =
          moves.try_emplace(design.model().parameters[parameter].effect, Eigen::Vector3d::Zero())
              .first->second;
      sum += design.geometric_jacobian().col(entry.coordinate).head<3>() * entry.value *
             design.values()[parameter];
    }
    for (const auto& [effect, move] : moves) squares[effect] += move.squaredNorm();
  }
  for (auto& [effect, sum] : squares) sum = std::sqrt(sum / static_cast<double>(design.rows()));
  return squares;
}

}  // namespace armtrue
