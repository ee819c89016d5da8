// Where the arm stands under its loads: they bend it, and the bent arm changes them.
#pragma once

#include <vector>

#include "fitter/design/design.h"

namespace armtrue {

/// Puts the loads of `state` to where the arm with these coefficients stands, by fixed-point
/// iteration, and `basis`, which reads that state, with them. What belongs to the measurement does
/// not move the arm. Returns how far the change of the loads moves a frame at most [m, or rad].
/// `feedback`, where given, is taken there. Loads that do not follow stay at the nominal arm.
double stand(State& state, BasisTable& basis, const Model& model, const std::vector<double>& values,
             const Kinematics& kinematics, LoadFeedback* feedback = nullptr);

/// The same for a model whose coefficients are its parameters' values.
void stand(State& state, const Model& model, const Kinematics& kinematics);

}  // namespace armtrue
