// Poses of base and tool as stated in model.yaml.
#pragma once

#include "fitter/design/model.h"
#include "fitter/model/kinematics.h"

namespace armtrue {

/// Moves the reference poses of base and tools to the poses that `specification` states: in the
/// measuring frame and in the flange, xyz [m] and rpy [rad] as in robot.yaml. The model's own
/// coordinates count from the references, so that a stated value becomes zero in them.
/// Throws ModelError for a part of a pose that the coordinates of a turned frame cannot hold.
void place_as_stated(const ModelSpecification& specification, const Model& model,
                     Kinematics& kinematics);

}  // namespace armtrue
