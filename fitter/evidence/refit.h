// Moves between models: a specification with one effect more or less, and the fit of it.
#pragma once

#include <map>
#include <memory>
#include <string>

#include "fitter/solve/fit.h"

namespace armtrue {

/// A request as text for users: "gear_harmonics 3".
std::string label(const EffectRequest& request);

/// The same model with one more effect. Options of the request that stand for nonlinear parameters
/// are dropped: the fit finds their values.
ModelSpecification with_effect(const ModelSpecification& specification,
                               const EffectRequest& request);
/// The same model without one effect on some joints (all of the entry where `joints` is empty).
ModelSpecification without_effect(const ModelSpecification& specification,
                                  const EffectRequest& request, const EffectContext& context);

/// Fits again with another specification, same measurements and options, beginning where `fit`
/// ended. `guesses`: start values of parameters that `fit` lacks. For nonlinear parameters they are
/// tried beside the parameters' own starts, with `keeps_weights` (FitOptions::keeps_weights)
/// instead of these.
std::unique_ptr<Fit> refit(const Fit& fit, const ModelSpecification& specification,
                           const std::map<std::string, double>& guesses = {},
                           bool keeps_weights = false);

}  // namespace armtrue
