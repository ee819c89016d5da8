// Moves between models: a specification with one effect more or less, and the fit of it.
#pragma once

#include <map>
#include <memory>
#include <string>

#include "fitter/solve/fit.h"

namespace armtrue {

/// "gear_harmonics 3": a request as people say it.
std::string label(const EffectRequest& request);

/// The same model with one more effect. `options` of the request that stand for nonlinear
/// parameters are left to be found.
ModelSpecification with_effect(const ModelSpecification& specification,
                               const EffectRequest& request);
/// The same model without one effect on some joints (all of the entry where `joints` is empty).
ModelSpecification without_effect(const ModelSpecification& specification,
                                  const EffectRequest& request, const EffectContext& context);

/// Fits again with another specification, same measurements and options, beginning where `fit`
/// ended. `guesses`: where parameters begin that `fit` does not have. Those of nonlinear ones are
/// tried beside their own starts, and in place of these with `keeps_weights`
/// (FitOptions::keeps_weights).
std::unique_ptr<Fit> refit(const Fit& fit, const ModelSpecification& specification,
                           const std::map<std::string, double>& guesses = {},
                           bool keeps_weights = false);

}  // namespace armtrue
