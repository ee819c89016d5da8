// The correction: motor positions that bring the real tool to where nominal kinematics puts it.
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

// Working memory of solve(): several kilobytes, kept off the stack.
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
//   1. p* is the nominal tool at the target. Gravity is taken there, because the corrected arm will
//      stand there, and all terms are evaluated there. Motor-side deflections m are subtracted
//      directly. The error of the virtual joints, e = p* - real tool without m, goes through the
//      arm's Jacobian: q₁ = target - m + J⁺ e.
//   2. Steep terms s (gear mesh, tables of joint errors) are evaluated at q₁, which is then moved
//      so that q₁ + s(q₁) has the intended value. All other terms and the real tool are evaluated
//      there: q₂ = q₁ + J⁺ (p* - p(q₁)).
//   3. Steep terms at q₂: q₃ by a secant, so that q₃ + s(q₃) = q₂ + s(q₁).
//
// J is the Jacobian of the nominal arm at the target, without the columns of passive joints, damped
// (damped_solver.h): every step removes all but some thousandths of the error. Near a singularity a
// large step moves the tool along a curve, for which J assumes a straight line, so only a share of
// it is taken (second_order.h). Position only, or full pose if the table says so. The result
// depends only on the arguments, not on earlier calls.
Correction solve(const TableView& table, const JointPositions& target,
                 const Surroundings& surroundings, Workspace& work);

}  // namespace armtrue

#endif  // ARMTRUE_FIRMWARE_CORE_EVALUATION_INVERSE_H_
