// Data that nodes refer to: cells of splines, axes, coverage and values of grids.
#include "firmware/core/fixed/bytes.h"
#include "firmware/core/table/limits.h"
#include "firmware/core/table/table_checker.h"

namespace armtrue {
namespace {

constexpr int kMaxCellShift = 30;
constexpr std::size_t kMaxOutputs = 8;
constexpr std::size_t kMaxGridNodes = 8192;

}  // namespace

// Checks that `length` bytes from data word `word` on lie in the data section.
bool Checker::check_data(std::int32_t word, std::size_t length, const std::uint8_t* at) {
  const std::size_t available = 4U * section(Section::kData).count;
  return require_at(word >= 0 && 4U * static_cast<std::size_t>(word) <= available &&
                        length <= available - 4U * static_cast<std::size_t>(word),
                    Refusal::kBadReference, at);
}

bool Checker::check_spline(const std::uint8_t* at, int shift) {
  const std::size_t cells = at[format::node::kCountAt];
  return check_shift(shift, 0, kMaxCellShift, at + format::node::kShiftAt) &&
         require_at(cells >= 1U, Refusal::kValueRange, at + format::node::kCountAt) &&
         check_data(load_i32(at + format::node::kRAt), cells * format::kSplineCellLength,
                    at + format::node::kRAt);
}

bool Checker::check_grid(const std::uint8_t* at, std::size_t slot, bool constant,
                         std::size_t& continued) {
  namespace grid = format::grid;
  const std::uint8_t* reference = at + format::node::kRAt;
  const std::int32_t word = load_i32(reference);
  if (!check_data(word, grid::kHeadLength, reference)) return false;
  const std::uint8_t* head = section(Section::kData).begin + 4 * static_cast<std::size_t>(word);
  const std::size_t axes = head[grid::kAxesAt];
  const std::size_t outputs = head[grid::kOutputsAt];
  if (!require_at(axes >= 1U && axes <= kMaxGridAxes, Refusal::kValueRange, head) ||
      !require_at(outputs >= 1U && outputs <= kMaxOutputs, Refusal::kValueRange, head + 1) ||
      !require_at(outputs == at[format::node::kCountAt], Refusal::kValueRange,
                  at + format::node::kCountAt) ||
      !require_zero(head + grid::kReservedAt, 2)) {
    return false;
  }
  std::size_t length = grid::kHeadLength;
  std::size_t nodes = 1;
  for (std::size_t i = 0; i < axes; ++i) {
    if (!check_data(word, length + grid::kAxisHeadLength, reference) ||
        !check_axis(word, head, slot, constant, length, nodes)) {
      return false;
    }
  }
  const std::size_t mask_length = grid::mask_length(nodes);
  const std::size_t value_length = (2U * nodes * outputs + 3U) & ~std::size_t{3};
  if (!check_data(word, length + mask_length + value_length, reference)) return false;
  continued = outputs - 1U;
  return check_coverage(head + length, head + length + mask_length, nodes, outputs);
}

// Checks the axis at head + length; adds its bytes to `length`, multiplies `nodes` by its nodes.
bool Checker::check_axis(std::int32_t word, const std::uint8_t* head, std::size_t slot,
                         bool constant, std::size_t& length, std::size_t& nodes) {
  namespace grid = format::grid;
  const std::uint8_t* axis = head + length;
  const std::size_t count = load_u16(axis + grid::kAxisNodesAt);
  const std::uint8_t flags = axis[grid::kAxisFlagsAt];
  const bool is_explicit = (flags & grid::kAxisExplicit) != 0U;
  if (!check_slot(load_u16(axis), slot, constant, axis) ||
      !require_at(count >= 2U && count <= kMaxGridNodes, Refusal::kValueRange,
                  axis + grid::kAxisNodesAt) ||
      !require_zero(axis + grid::kAxisReservedAt, 3) ||
      !require_at((flags & ~grid::kAxisKnownFlags) == 0, Refusal::kUnknownFlag,
                  axis + grid::kAxisFlagsAt)) {
    return false;
  }
  length += grid::kAxisHeadLength + grid::axis_length(count, is_explicit);
  nodes *= count;
  if (!require_at(nodes <= kMaxGridNodes, Refusal::kTooManyRecords, head) ||
      !check_data(word, length, axis)) {
    return false;
  }
  const std::uint8_t* first = axis + grid::kAxisHeadLength;
  if (!is_explicit) return require_at(load_u32(first + 4) != 0U, Refusal::kValueRange, first + 4);
  for (std::size_t i = 1; i < count; ++i) {
    const std::uint8_t* inverse = first + 4 * (count + i - 1);
    if (!require_at(load_i32(first + 4 * i) > load_i32(first + 4 * (i - 1)), Refusal::kValueRange,
                    first + 4 * i) ||
        !require_at(load_u32(inverse) != 0U, Refusal::kValueRange, inverse)) {
      return false;
    }
  }
  return true;
}

// Nodes that are not covered must hold zero, so that interpolation needs no test at run time.
bool Checker::check_coverage(const std::uint8_t* mask, const std::uint8_t* values,
                             std::size_t nodes, std::size_t outputs) {
  for (std::size_t n = 0; n < nodes; ++n) {
    const bool is_covered = ((mask[n / 8U] >> (n % 8U)) & 1U) != 0U;
    for (std::size_t o = 0; o < outputs && !is_covered; ++o) {
      const std::uint8_t* value = values + 2U * (n * outputs + o);
      if (!require_at(load_i16(value) == 0, Refusal::kValueRange, value)) return false;
    }
  }
  return true;
}

}  // namespace armtrue
