#include "firmware/core/evaluation/damped_solver.h"

#include <bit>
#include <utility>

namespace armtrue {
namespace {

// Number formats: the error is scaled to 25 significant bits and read as a fraction below 1
// (forward substitution enlarges it at most by 2^5). y = (J Jᵀ + λ² I)⁻¹ e has 14 fraction bits (λ
// ≥ 2^-8 bounds it by 2^16), the step Σ J y has 22 + 14.
constexpr int kErrorBits = 25;
constexpr int kSolutionFraction = 14;
constexpr int kSquareFraction = 2 * kJacobianFraction;

// Steps are kept below half a radian or metre, which is more than any permitted correction
// (limits.h), so that sums of a few steps fit 32 bits. Longer steps are halved until they are
// below.
constexpr int kMaxStepBits = 64 - (Coordinate::fraction - 1);

}  // namespace

void DampedSolver::factor(const Jacobian& jacobian, std::size_t joints, std::size_t rows,
                          Length damping) {
  jacobian_ = &jacobian;
  joints_ = joints;
  rows_ = rows;
  std::array<std::array<std::int64_t, kMaxRows>, kMaxRows> wide;
  // λ² with 44 fraction bits from λ with 27.
  const std::int64_t floor =
      round_shift(product(damping.raw, damping.raw), 2 * Length::fraction - kSquareFraction);
  std::int64_t largest = 0;
  for (std::size_t i = 0; i < rows; ++i) {
    for (std::size_t j = 0; j <= i; ++j) {
      std::int64_t sum = i == j ? floor : 0;
      for (std::size_t k = 0; k < joints_; ++k) {
        sum += product(jacobian[k][i], jacobian[k][j]);
      }
      wide[i][j] = sum;
    }
    largest = wide[i][i] > largest ? wide[i][i] : largest;
  }
  // Scales the largest diagonal element to 30 bits. It is at least λ² · 2^44 ≥ 2^28, and has fewer
  // than 30 bits where all axes pass through the tool.
  const int scale = 34 - std::countl_zero(static_cast<std::uint64_t>(largest));
  scale_ = scale > 1 ? scale : 1;
  std::array<std::array<std::int32_t, kMaxRows>, kMaxRows> a;
  for (std::size_t i = 0; i < rows; ++i) {
    order_[i] = static_cast<std::uint8_t>(i);
    for (std::size_t j = 0; j <= i; ++j) {
      a[i][j] = static_cast<std::int32_t>(round_shift(wide[i][j], scale_));
      a[j][i] = a[i][j];
    }
  }
  // λ² in the same scale, but at least 2, so that the shift 31 - exponent in the division below is
  // at least 1 where couplings make the largest element 2^30 times as large.
  const std::int64_t smallest = (floor >> scale_) > 2 ? floor >> scale_ : 2;
  std::int64_t last_pivot = 0;
  for (std::size_t k = 0; k < rows; ++k) {
    std::size_t pivot = k;
    for (std::size_t i = k + 1; i < rows; ++i) {
      pivot = a[order_[i]][order_[i]] > a[order_[pivot]][order_[pivot]] ? i : pivot;
    }
    std::swap(order_[k], order_[pivot]);
    const std::size_t p = order_[k];
    // In exact arithmetic no pivot is below λ²; with rounding it is raised to λ².
    last_pivot = a[p][p] > smallest ? a[p][p] : smallest;
    inverse_pivot_[k] = reciprocal(static_cast<std::uint32_t>(last_pivot));
    const Reciprocal& inverse = inverse_pivot_[k];
    for (std::size_t i = k + 1; i < rows; ++i) {
      // L = a / pivot: Q30 quotient of two 30-bit numbers. Pivoting bounds it by 1, apart from
      // rounding.
      const std::size_t r = order_[i];
      lower_[r][k] =
          saturate(round_shift(product(a[r][p], static_cast<std::int32_t>(inverse.mantissa >> 1U)),
                               31 - inverse.exponent));
    }
    for (std::size_t i = k + 1; i < rows; ++i) {
      const std::size_t r = order_[i];
      for (std::size_t j = k + 1; j <= i; ++j) {
        const std::size_t c = order_[j];
        a[r][c] -= multiply<30>(lower_[r][k], a[c][p]);
        a[c][r] = a[r][c];
      }
    }
  }
  is_near_singular_ = last_pivot < 100 * smallest;
}

JointStep DampedSolver::step(const ToolError& error) const {
  const std::size_t rows = rows_;
  std::uint32_t largest = 1;
  for (std::size_t i = 0; i < rows; ++i) {
    const std::uint32_t size = magnitude(error[i].raw);
    largest = size > largest ? size : largest;
  }
  // Left shift that scales the largest element to kErrorBits bits.
  const int lift = std::countl_zero(largest) - (32 - kErrorBits);
  std::array<std::int32_t, kMaxRows> e;
  for (std::size_t i = 0; i < rows; ++i) {
    const std::int32_t raw = error[order_[i]].raw;
    e[i] = lift >= 0 ? raw * (std::int32_t{1} << lift) : raw >> -lift;
  }
  for (std::size_t i = 1; i < rows; ++i) {
    for (std::size_t j = 0; j < i; ++j) {
      e[i] -= multiply<30>(lower_[order_[i]][j], e[j]);
    }
  }
  // y = e / d: e has 25 fraction bits, d = pivot · 2^(scale - 44), y gets 14.
  std::array<std::int32_t, kMaxRows> y;
  for (std::size_t i = 0; i < rows; ++i) {
    const Reciprocal& inverse = inverse_pivot_[i];
    const int shift =
        62 - inverse.exponent + kErrorBits - kSolutionFraction - kSquareFraction + scale_ - 1;
    const std::int64_t wide = product(e[i], static_cast<std::int32_t>(inverse.mantissa >> 1U));
    y[i] = saturate(shift > 0 ? round_shift(wide, shift) : wide);
  }
  for (std::size_t i = rows; i-- > 0;) {
    for (std::size_t j = i + 1; j < rows; ++j) {
      y[i] = saturate(static_cast<std::int64_t>(y[i]) - multiply<30>(lower_[order_[j]][i], y[j]));
    }
  }
  std::array<std::int32_t, kMaxRows> solution;
  for (std::size_t i = 0; i < rows; ++i) {
    solution[order_[i]] = y[i];
  }
  // Σ J y has 36 fraction bits for an error lifted by `lift` and read with 25 bits instead of 30.
  const int down = kJacobianFraction + kSolutionFraction - kErrorBits + lift;
  std::array<std::int64_t, kMaxJoints> wanted;
  std::uint64_t longest = 0;
  for (std::size_t k = 0; k < joints_; ++k) {
    std::int64_t sum = 0;
    for (std::size_t i = 0; i < rows; ++i) {
      sum += product((*jacobian_)[k][i], solution[i]);
    }
    wanted[k] = round_shift(sum, down);
    longest |= static_cast<std::uint64_t>(wanted[k] < 0 ? -wanted[k] : wanted[k]);
  }
  // In long steps joints turn against each other: clamping one alone would move the tool far off.
  const int over = kMaxStepBits - std::countl_zero(longest);
  JointStep step;
  for (std::size_t k = 0; k < joints_; ++k) {
    step[k].raw = static_cast<std::int32_t>(over > 0 ? wanted[k] >> over : wanted[k]);
  }
  return step;
}

}  // namespace armtrue
