// Model changes that a diagnosis suggests.
#pragma once

#include <optional>
#include <vector>

#include "fitter/diagnose/diagnose.h"

namespace armtrue {

/// A change of the model: effects added and removed.
struct Move {
  std::optional<Candidate> added;
  std::vector<EffectRequest> removed;
  bool sure = false;  ///< can follow another move of its search without a new search
};

/// Whether the search that found a candidate is sure of it.
bool is_sure(const Candidate& c);

/// Whether `one` names `other` as an alternative (confounded_with).
bool names(const Candidate& one, const Candidate& other);

/// Whether a candidate is a table, which follows an error of any cause.
bool is_table(const Candidate& c);

/// The moves that a diagnosis suggests, in this order: sure candidates, physical effects before
/// tables, which would absorb them; the recommended one; other probable ones; removals; exchanges.
std::vector<Move> moves_of(const Diagnosis& d);

/// The specification after a move.
ModelSpecification apply(ModelSpecification specification, const Move& move,
                         const EffectContext& context);

}  // namespace armtrue
