// The parameters that the data determine, and a sentence for each one that they do not.
#pragma once

#include <string>
#include <vector>

#include "fitter/design/normal_equations.h"

namespace armtrue {

struct Unidentifiable {
  int parameter = 0;  ///< index into Model::parameters; held at its prior mean
  int explained_by =
      -1;  ///< the kept parameter that reproduces most of it; −1: it does not move the tool
  bool exact = false;  ///< true: not separable in principle; false: hardly separable by these poses
  std::string sentence;
};

struct Identifiability {
  std::vector<int> kept;  ///< parameters to be solved for, in model order
  std::vector<Unidentifiable> held;
};

/// Keeps each parameter that the data alone determine to better than its prior's standard deviation
/// beside the parameters already kept; effects also to better than a third of their physical bound.
/// Method: rank-revealing Cholesky factorisation of JᵀJ. Geometry comes before effects. Within
/// each, clearly determined parameters are accepted in a fixed order of preference (base, tool,
/// zeros, lengths, twists), the others by how well they are determined. The kept geometry is
/// minimal and complete (four parameters per revolute joint in the generic case). `design` must
/// have all candidates free. Table nodes are always kept: penalties hold their gauges and
/// smoothness.
Identifiability identify(const Design& design);

/// A parameter as text for users: "axis 3's zero", "the tool's y" …
std::string describe(const Parameter& parameter);

}  // namespace armtrue
