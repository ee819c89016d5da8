#include "firmware/core/evaluation/correction_limits.h"

#include <algorithm>

#include "firmware/core/fixed/bytes.h"
#include "firmware/core/table/format.h"

namespace armtrue {
namespace {

// |x| of any 32-bit number, the smallest included.
constexpr std::uint32_t size_of(std::int32_t x) {
  return x < 0 ? 0U - static_cast<std::uint32_t>(x) : static_cast<std::uint32_t>(x);
}

// The joint with the largest ratio of correction to limit. Ratios are compared by
// cross-multiplication, so that a limit of zero causes no division by zero.
std::size_t furthest_beyond(const JointAmounts& largest, std::uint32_t beyond,
                            const JointAmounts& correction) {
  std::size_t worst = 0;
  while ((beyond >> worst & 1U) == 0U) ++worst;
  for (std::size_t k = worst + 1; beyond >> k != 0U; ++k) {
    if ((beyond >> k & 1U) == 0U) continue;
    const std::uint64_t own = std::uint64_t{size_of(correction[k])} * size_of(largest[worst]);
    const std::uint64_t other = std::uint64_t{size_of(correction[worst])} * size_of(largest[k]);
    if (own > other) worst = k;
  }
  return worst;
}

}  // namespace

std::int32_t largest_correction(const TableView& table, std::size_t joint) {
  return std::min(table.is_prismatic(joint) ? kMaxDeltaPrismatic : kMaxDeltaRevolute,
                  load_i32(table.joint(joint) + format::joint::kMagnitudeAt));
}

std::uint32_t scale_into_limits(const JointAmounts& largest, std::size_t joints,
                                JointAmounts& correction) {
  std::uint32_t beyond = 0;
  for (std::size_t k = 0; k < joints; ++k) {
    if (size_of(correction[k]) > size_of(largest[k])) beyond |= 1U << k;
  }
  if (beyond == 0U) return 0;
  const std::size_t worst = furthest_beyond(largest, beyond, correction);
  // Q32, rounded up, so that the worst joint ends at its limit and not one unit below. No joint
  // exceeds its own, because the rounding adds at most half a unit, which is cut off.
  const std::uint32_t size = size_of(correction[worst]);
  constexpr std::uint64_t kWhole = 0x1'0000'0000;
  const auto share =
      static_cast<std::uint32_t>((size_of(largest[worst]) * kWhole + size - 1U) / size);
  for (std::size_t k = 0; k < joints; ++k) {
    const auto scaled =
        static_cast<std::int32_t>(std::uint64_t{size_of(correction[k])} * share / kWhole);
    correction[k] = correction[k] < 0 ? -scaled : scaled;
  }
  return beyond;
}

}  // namespace armtrue
