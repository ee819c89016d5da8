// Candidate blocks: sets of columns that might explain what a fit leaves over.
#pragma once

#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "fitter/effects/effect.h"
#include "fitter/solve/fit.h"

namespace armtrue {

/// A candidate block with one column for each parameter of `terms`. Nonlinear parameters are fixed
/// at the values in the request's options.
struct Block {
  EffectRequest request;
  EffectTerms terms;
  int searched = 0;  ///< unknowns (a period, a phase) that a grid search chose: each costs a
                     ///< degree of freedom
};

/// Every effect of the catalogue on every joint (pair, order, sensor) that the recorded columns
/// allow and that the fit does not contain already.
std::vector<Block> catalogue_blocks(const Fit& fit);

/// An effect that cannot be tested, and the columns to record before it can.
struct Untestable {
  std::string effect;
  std::vector<std::string> needs;
};

/// Effects that the recorded columns do not allow to test, on some joints or on all.
std::vector<Untestable> untestable_effects(const EffectContext& context);

/// As the contract's `untestable`: a list of {effect, needs}.
nlohmann::json to_json(const std::vector<Untestable>& untestable);

/// The request as it enters a model: without the options that candidates step through.
EffectRequest as_added(const EffectRequest& request);

/// Builds the block of one request; nonlinear parameters without an option are fixed at their
/// initial value.
Block make_block(const EffectContext& context, const EffectRequest& request);

}  // namespace armtrue
