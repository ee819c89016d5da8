// Searches for causes outside the catalogue that are known beforehand.
#pragma once

#include <optional>

#include "fitter/diagnose/scoring/finding.h"
#include "fitter/solve/fit.h"

namespace armtrue {

/// Finds the likeliest step in time: of the base (a knocked tracker), of all reflectors or one
/// (taken out and put back), or of the load. Leaves `log10_p` to the caller. Returns nothing if a
/// smooth change over time of the same coordinates explains clearly more, or if no time was
/// recorded, or if the base stepped in a pause (find_new_set_up).
std::optional<StructureFinding> find_knock(const Scorer& scorer, const Fit& fit);

/// A step of the base in one of the pauses of an hour or more, in which the instrument may have
/// been set up anew: the likeliest, however small. A drift over two sessions looks the same.
/// Returns nothing if there was no such pause, or if a column `station` names the set-ups.
std::optional<StructureFinding> find_new_set_up(const Scorer& scorer, const Fit& fit);

/// True where a column `payload` has more than one value.
bool payload_varies(const State& state);

/// Finds a base that swings many times in a session (air conditioning, the sun between clouds): the
/// likeliest course over time on one axis. Leaves `log10_p` to the caller. Returns nothing if the
/// best course has only a few swings, or if no time was recorded.
std::optional<StructureFinding> find_swings(const Scorer& scorer, const State& state);

/// Finds the joint whose error follows the direction of its motion from row to row, among joints
/// whose direction of approach is not recorded. Leaves `log10_p` to the caller.
std::optional<StructureFinding> find_motion(const Scorer& scorer, const State& state);

/// Finds the joint whose spring is softer at some of its angles than at others, once or twice a
/// turn: the likeliest. Leaves `log10_p` to the caller. Returns nothing if the arm's masses are
/// not given.
std::optional<StructureFinding> find_uneven_spring(const Scorer& scorer, const Fit& fit);

/// Finds the joint whose zero changes with the square of a temperature: the likeliest. A gear that
/// is warmer than its sensor looks nearly the same. Leaves `log10_p` to the caller. Returns nothing
/// if no temperature was recorded.
std::optional<StructureFinding> find_curved_heat(const Scorer& scorer, const Fit& fit);

}  // namespace armtrue
