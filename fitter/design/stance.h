// Equilibrium of the arm under its loads: they deflect it, and the deflection changes them.
#pragma once

#include <vector>

#include "fitter/design/design.h"

namespace armtrue {

/// Moves the loads of `state`, and `basis`, which reads that state, to the equilibrium of the arm
/// with these coefficients, by fixed-point iteration. Parameters of the measurement do not move the
/// arm. Returns how far the change of the loads moves a frame at most [m, or rad]. `feedback`, if
/// given, is updated there. Loads that do not follow (State::let_loads_follow) stay those of the
/// nominal arm.
double stand(State& state, BasisTable& basis, const Model& model, const std::vector<double>& values,
             const Kinematics& kinematics, LoadFeedback* feedback = nullptr);

/// The same for a model whose coefficients are its parameters' values.
void stand(State& state, const Model& model, const Kinematics& kinematics);

}  // namespace armtrue
