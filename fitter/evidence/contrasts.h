// Differences between repeated readings of one pose: they show the scatter of readings only.
#pragma once

#include <Eigen/Core>

#include "fitter/evidence/linearization.h"
#include "fitter/evidence/noise.h"

namespace armtrue {

/// Sum of squares, and degrees of freedom, of the differences between readings of one pose that no
/// column of the model can explain. They measure the scatter of single readings only, and are left
/// out of the estimate of the scatter between poses: fifty poses, each read a hundred times, give
/// fifty values of that scatter; with these differences it would seem to be known from five
/// thousand.
struct IdleContrasts {
  double squares = 0.0, freedom = 0.0;
};

/// `white`: the model's columns and, in the last column, the residual, all whitened by `whitening`.
/// `target`: reflector of each row of `linearization`.
IdleContrasts idle_contrasts(const Linearization& linearization, const std::vector<int>& target,
                             const PoseWhitening& whitening, const Eigen::MatrixXd& white);

}  // namespace armtrue
