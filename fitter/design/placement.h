// What model.yaml states of the base's and the tool's pose.
#pragma once

#include "fitter/design/model.h"
#include "fitter/model/kinematics.h"

namespace armtrue {

/// Moves the reference poses of base and tools to where `specification` says that they are: in the
/// measuring frame and in the flange, xyz [m] and rpy [rad] as in robot.yaml. The model's own
/// coordinates, which count from the references, then have zero for what is stated.
/// Throws ModelError for a part of a pose that the coordinates of a turned frame cannot hold.
void place_as_stated(const ModelSpecification& specification, const Model& model,
                     Kinematics& kinematics);

}  // namespace armtrue
