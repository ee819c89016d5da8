// Least-norm joint steps for small tool errors: damped least squares in fixed point.
#ifndef ARMTRUE_FIRMWARE_CORE_EVALUATION_DAMPED_SOLVER_H_
#define ARMTRUE_FIRMWARE_CORE_EVALUATION_DAMPED_SOLVER_H_

#include <array>
#include <cstddef>
#include <cstdint>

#include "firmware/core/fixed/fixed.h"
#include "firmware/core/table/limits.h"

namespace armtrue {

inline constexpr std::size_t kMaxRows = 6;

// Jacobian column of one motor: tool velocity per unit of joint rate, Q22 (metre per radian; rows 4
// to 6 are rotations times the rotation length). |element| < 16.
using JacobianColumn = std::array<std::int32_t, kMaxRows>;
using Jacobian = std::array<JacobianColumn, kMaxJoints>;
inline constexpr int kJacobianFraction = 22;

using ToolError = std::array<Coordinate, kMaxRows>;  // metre; rotations times the rotation length
using JointStep = std::array<Coordinate, kMaxJoints>;

// dq = Jᵀ (J Jᵀ + λ² I)⁻¹ e (Wampler 1986; Nakamura and Hanafusa 1986).
//
// Bound: |dq| ≤ |e| / (2 λ), whatever the posture; along a direction with singular value σ a step
// leaves λ² / (σ² + λ²) of the error. The step is an analytic function of the posture: smooth
// through singularities. J Jᵀ + λ² I is factored as P L D Lᵀ Pᵀ with diagonal pivoting, which keeps
// every element of L within ±1 (Golub and Van Loan, Matrix Computations, 4.2.8).
class DampedSolver {
 public:
  // `rows`: 3 (position) or 6 (pose). `damping` λ ≥ 2^-8 m.
  void factor(const Jacobian& jacobian, std::size_t joints, std::size_t rows, Length damping);

  // The step for an error.
  JointStep step(const ToolError& error) const;

  // True if some direction has σ² < 99 λ²: there the damping takes more than 1 % of a step.
  bool is_near_singular() const { return is_near_singular_; }

 private:
  const Jacobian* jacobian_ = nullptr;
  std::size_t joints_ = 0;
  std::size_t rows_ = 0;
  int scale_ = 0;  // the factored matrix is (J Jᵀ + λ² I) · 2^-scale_, in raw Q44
  std::array<std::uint8_t, kMaxRows> order_ = {};
  std::array<std::array<std::int32_t, kMaxRows>, kMaxRows> lower_ = {};  // Q30
  std::array<Reciprocal, kMaxRows> inverse_pivot_ = {};
  bool is_near_singular_ = false;
};

}  // namespace armtrue

#endif  // ARMTRUE_FIRMWARE_CORE_EVALUATION_DAMPED_SOLVER_H_
