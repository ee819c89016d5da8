// Options that a model leaves open and that held-out error decides: how fine a table is.
#pragma once

#include "fitter/solve/fit.h"

namespace armtrue {

/// `specification` with every open option closed (Effect::refinements). Starting from the coarsest
/// form, the refinement with the least held-out error is taken as long as it predicts better; the
/// smoothness that suits each best is taken with it. Held-out errors are those of one Gauss–Newton
/// step from the fit without the effect, which is exact for tables up to the model's slight
/// curvature. A specification that leaves nothing open comes back as it is, at no cost. Throws
/// ModelError.
ModelSpecification close_options(const State& state, const ModelSpecification& specification,
                                 const FitOptions& options);

}  // namespace armtrue
