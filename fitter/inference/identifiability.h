// Which parameters the data can tell apart, decided from the data, and in words what they cannot.
#pragma once

#include <string>
#include <vector>

#include "fitter/design/normal_equations.h"

namespace armtrue {

struct Unidentifiable {
  int parameter = 0;  ///< index into Model::parameters; held at its prior mean
  int explained_by =
      -1;  ///< the kept parameter that stands in for most of it; −1: the data do not see it at all
  bool exact = false;  ///< true: one number in principle; false: too weakly seen by these poses
  std::string sentence;
};

struct Identifiability {
  std::vector<int> kept;  ///< parameters to be solved for, in model order
  std::vector<Unidentifiable> held;
};

/// Keeps each parameter whose standard deviation from the data alone, given those already kept, is
/// below its prior's, of effects below a third of their physical bound: a rank-revealing Cholesky
/// factorisation of JᵀJ. Geometry comes before effects; within each, what the data clearly see is
/// taken in a fixed order of preference (base, tool, zeros, lengths, twists) and the rest by how
/// well they see it. What is kept of the geometry is minimal and complete (four parameters a
/// revolute joint in the generic case). `design` must have all candidates free. Table nodes are
/// always kept: their gauges and smoothness are penalties.
Identifiability identify(const Design& design);

/// "axis 3's zero", "the tool's y" …: a parameter as people say it.
std::string describe(const Parameter& parameter);

}  // namespace armtrue
