// The correction: which motor positions bring the real tool where nominal kinematics puts it.
#ifndef ARMTRUE_FIRMWARE_CORE_EVALUATION_INVERSE_H_
#define ARMTRUE_FIRMWARE_CORE_EVALUATION_INVERSE_H_

#include <array>
#include <cstdint>

#include "firmware/core/evaluation/correction_limits.h"
#include "firmware/core/evaluation/damped_solver.h"
#include "firmware/core/evaluation/kinematics.h"
#include "firmware/core/evaluation/terms.h"
#include "firmware/core/table/table_view.h"

namespace armtrue {

// Memory that solve() works in; several kilobytes, so that it is not on the stack.
struct Workspace {
  TermWorkspace terms;
  Coordinates coordinates = {};
  JointPositions link = {};
  JointPositions moved_link = {};
  JointMotions motions = {};
  Frames frames = {};
  Jacobian jacobian = {};
  DampedSolver solver;
};

struct Correction {
  JointAmounts delta = {};  // before any limit
  bool is_near_singular = false;
  bool is_outside_coverage = false;
  bool is_saturated = false;
};

// Finds δ so that real(target + δ) = nominal(target), by Newton's method on the full model:
//
//   1. p* = nominal tool at the target. Gravity there, where the corrected arm will stand. Terms at
//      the target. Motor-side deflections m are taken off
//      directly; what the virtual joints leave, e = p* - real tool without m, goes through the
//      arm's Jacobian: q₁ = target - m + J⁺ e.
//   2. Steep terms s (gear mesh, tables of joint errors) at q₁, which moves on to where q₁ + s(q₁)
//   is
//      what it was to be. All other terms and the real tool there: q₂ = q₁ + J⁺ (p* -
//      p(q₁)).
//   3. Steep terms at q₂: q₃ by a secant, so that q₃ + s(q₃) = q₂ + s(q₁).
//
// J is that of the nominal arm at the target, without the columns of passive joints, damped
// (damped_solver.h): every step takes off all but some thousandths of the error. A large step near
// a singularity moves the tool along a curve, where J draws a straight line: only a share of it is
// taken (second_order.h). Position only, or full pose where the table says so. The result depends
// on nothing but the arguments: no history.
Correction solve(const TableView& table, const JointPositions& target,
                 const Surroundings& surroundings, Workspace& work);

}  // namespace armtrue

#endif  // ARMTRUE_FIRMWARE_CORE_EVALUATION_INVERSE_H_
