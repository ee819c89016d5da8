// What differs between readings of one place, and tells of no model.
#pragma once

#include <Eigen/Core>

#include "fitter/evidence/linearization.h"
#include "fitter/evidence/noise.h"

namespace armtrue {

/// Squares that no column can explain, since the readings they are of share every column, and how
/// many degrees of freedom they have. They tell the scatter of shots. How far a pose as a whole
/// scatters is told by the rest alone: counted with it, a hundred shots of fifty poses would make
/// fifty numbers as sure as five thousand.
struct IdleContrasts {
  double squares = 0.0, freedom = 0.0;
};

/// `white`: columns and, last, what they explain, whitened by `whitening`. `target`: reflector of
/// each row of `linearization`.
IdleContrasts idle_contrasts(const Linearization& linearization, const std::vector<int>& target,
                             const PoseWhitening& whitening, const Eigen::MatrixXd& white);

}  // namespace armtrue
