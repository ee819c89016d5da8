// How smooth the tables of a model are: one standard deviation for all, and a factor for each
// effect that has tables.
#pragma once

#include <map>
#include <string>

#include "fitter/design/design.h"

namespace armtrue {

struct Smoothness {
  double sigma = 1e-4;                  ///< [rad or m] of what neighbours differ by
  double noise = 0.0;                   ///< of a reading where sigma was chosen [m]
  std::map<std::string, double> scale;  ///< by effect, beside the common one

  bool operator==(const Smoothness&) const = default;
};

/// True where the model has tables.
bool has_tables(const Model& model);

/// Tables of one effect are as smooth as each other; those of another one need not be.
void scale_smoothness(Model& model, const std::string& effect, double factor);

/// The smoothness under which the data are likeliest, beginning at `present`, whose factors are in
/// the penalties of `model`, and those of the result afterwards. `design` is of that model.
Smoothness choose_smoothness(Design& design, Model& model, const Smoothness& present);

}  // namespace armtrue
