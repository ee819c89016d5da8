// Candidate blocks: sets of columns that might explain what a fit leaves over.
#pragma once

#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "fitter/effects/effect.h"
#include "fitter/solve/fit.h"

namespace armtrue {

/// One block: its columns are the parameters of `terms`, nonlinear ones at the values given in the
/// request's options.
struct Block {
  EffectRequest request;
  EffectTerms terms;
  int searched = 0;  ///< unknowns that were searched over to find this block (a period, a phase):
                     ///< they cost evidence
};

/// Every effect of the catalogue on every joint (pair, order, sensor) that the recorded columns
/// allow and that the fit does not hold already.
std::vector<Block> catalogue_blocks(const Fit& fit);

/// An effect that cannot be tested, and the columns to record before it can.
struct Untestable {
  std::string effect;
  std::vector<std::string> needs;
};

/// What the recorded columns do not allow to test, on some joints or on any.
std::vector<Untestable> untestable_effects(const EffectContext& context);

/// As the contract's `untestable`: a list of {effect, needs}.
nlohmann::json to_json(const std::vector<Untestable>& untestable);

/// The request without the options that candidates step through: what goes into a model.
EffectRequest as_added(const EffectRequest& request);

/// Builds the block of one request; nonlinear parameters without an option stand at their initial
/// value.
Block make_block(const EffectContext& context, const EffectRequest& request);

}  // namespace armtrue
