// Changes of a model that a search asks for.
#pragma once

#include <optional>
#include <vector>

#include "fitter/diagnose/diagnose.h"

namespace armtrue {

/// A change of the model: what comes in, what goes.
struct Move {
  std::optional<Candidate> added;
  std::vector<EffectRequest> removed;
  bool sure = false;  ///< can follow another move of its search without a new search
};

/// Whether a search of which this is a candidate is sure of it.
bool is_sure(const Candidate& c);

/// Whether `one` names `other` among what may stand in its place.
bool names(const Candidate& one, const Candidate& other);

/// Whether a candidate is a table, which follows whatever its cause is.
bool is_table(const Candidate& c);

/// What a search asks for, in this order: what is surely there, physical effects before tables,
/// which would swallow them; else the most probable; then what may go.
std::vector<Move> moves_of(const Diagnosis& d);

/// The specification with a move made.
ModelSpecification apply(ModelSpecification specification, const Move& move,
                         const EffectContext& context);

}  // namespace armtrue
