// Smoothness of a model's tables: one standard deviation for all, and a factor for each effect that
// has tables.
#pragma once

#include <map>
#include <string>

#include "fitter/design/design.h"

namespace armtrue {

struct Smoothness {
  double sigma = 1e-4;                  ///< [rad or m] of second differences
  double noise = 0.0;                   ///< a reading's sigma [m] when `sigma` was chosen
  std::map<std::string, double> scale;  ///< by effect: factor on sigma

  bool operator==(const Smoothness&) const = default;
};

/// True where the model has tables.
bool has_tables(const Model& model);

/// Multiplies the standard deviations in the smoothness penalties of an effect's tables by
/// `factor`.
void scale_smoothness(Model& model, const std::string& effect, double factor);

/// The smoothness of largest evidence, searched from `present`. The penalties of `model` contain
/// the factors of `present` on entry, and those of the result on return. `design` belongs to
/// `model`.
Smoothness choose_smoothness(Design& design, Model& model, const Smoothness& present);

}  // namespace armtrue
