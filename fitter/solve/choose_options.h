// Chooses by held-out error the options that a model leaves open, such as how fine a table is.
#pragma once

#include "fitter/solve/fit.h"

namespace armtrue {

/// `specification` with every open option closed (Effect::refinements). Starting from the coarsest
/// form, the refinement with the least held-out error is taken as long as that error falls, each
/// form at its best smoothness. Held-out errors are those of one Gauss–Newton step from the fit
/// without the effect, which is exact for tables except for the model's slight curvature. A
/// specification without open options is returned unchanged, and nothing is fitted. Throws
/// ModelError.
ModelSpecification close_options(const State& state, const ModelSpecification& specification,
                                 const FitOptions& options);

}  // namespace armtrue
