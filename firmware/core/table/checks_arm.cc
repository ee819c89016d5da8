// The arm: joints and their drives, tools, coupling, sensors, masses.
#include "firmware/core/fixed/bytes.h"
#include "firmware/core/fixed/fixed.h"
#include "firmware/core/fixed/ratio.h"
#include "firmware/core/table/limits.h"
#include "firmware/core/table/table_checker.h"

namespace armtrue {
namespace {

constexpr std::int64_t kMaxReach = std::int64_t{12} << Length::fraction;
constexpr std::int32_t kMaxPayloadArm = std::int32_t{4} << Length::fraction;
constexpr std::int64_t kMaxOffset = std::int64_t{8} << 32;
constexpr int kMaxShift = 62;
// Largest sum of the ratios by which one motor drives other joints; gears and parallelograms have
// ratios about 1. An element of the Jacobian is then at most 9 times 23 m, and the solver's sums of
// products fit 64 bits.
constexpr std::int64_t kMaxDriven = std::int64_t{8} << format::coupling::kRatioFraction;

}  // namespace

// Checks that rows have unit length; adds the translation's size to `reach`.
bool Checker::check_transform(const std::uint8_t* at, std::int64_t& reach) {
  constexpr std::int64_t kOne = std::int64_t{1} << (2 * Ratio::fraction);
  constexpr std::int64_t kTolerance = std::int64_t{1} << 36;
  for (std::size_t row = 0; row < 3; ++row) {
    std::int64_t square = 0;
    for (std::size_t column = 0; column < 3; ++column) {
      const std::uint8_t* element = at + 4 * (3 * row + column);
      const std::int32_t value = load_i32(element);
      if (!require_at(absolute(value) <= kRatioOne.raw, Refusal::kValueRange, element)) {
        return false;
      }
      square += product(value, value);
    }
    if (!require_at(absolute(square - kOne) <= kTolerance, Refusal::kValueRange, at + 12 * row)) {
      return false;
    }
  }
  const std::uint8_t* translation = at + format::transform::kTranslationAt;
  for (std::size_t i = 0; i < 3; ++i) {
    reach += absolute(load_i32(translation + 4 * i));
  }
  return require_at(reach <= kMaxReach, Refusal::kValueRange, translation);
}

bool Checker::check_scale(const std::uint8_t* at) {
  const std::uint8_t* back = at + format::joint::kIncrementPerUnitAt;
  const std::int64_t u = load_i32(at + format::joint::kUnitPerIncrementAt);
  const std::int64_t v = load_i32(back);
  const int s = at[format::joint::kUnitShiftAt];
  const int t = at[format::joint::kIncrementShiftAt];
  if (!check_shift(s, 1, kMaxShift, at + format::joint::kUnitShiftAt) ||
      !check_shift(t, 1, kMaxShift, at + format::joint::kIncrementShiftAt)) {
    return false;
  }
  // The scales must be each other's inverse: u/2^s · v/2^t = 1.
  const std::int64_t both = u * v;
  const bool is_inverse =
      both > 0 && nearly_equal({static_cast<std::uint64_t>(both), -(s + t)}, {1, 0});
  // 2^4 … 2^31 increments a unit: |v| / 2^t lies in 2^-28 … 2^-1.
  const Scaled size = normalised({magnitude(v), -t});
  const int power = size.exponent + 63;  // 2^power ≤ |v| / 2^t < 2^(power + 1)
  const bool is_largest = power == -1 && size.mantissa == std::uint64_t{1} << 63U;
  const bool is_in_range = power >= -28 && (power < -1 || is_largest);
  return require_at(is_inverse && is_in_range, Refusal::kScale, back);
}

bool Checker::check_joints() {
  return all_records(Section::kJoints, [this](const std::uint8_t* at, std::size_t) {
    const std::uint8_t* rate = at + format::joint::kRateAt;
    return check_transform(at + format::joint::kTransformAt, reach_) &&
           require_at(absolute(load_i64(at + format::joint::kOffsetAt) >> 1) <= kMaxOffset / 2,
                      Refusal::kValueRange, at + format::joint::kOffsetAt) &&
           check_scale(at) &&
           require_at(at[format::joint::kTypeAt] <= 1U, Refusal::kUnknownKind,
                      at + format::joint::kTypeAt) &&
           require_at((at[format::joint::kFlagsAt] & ~format::joint::kAllFlags) == 0,
                      Refusal::kReserved, at + format::joint::kFlagsAt) &&
           require_at(load_i32(at + format::joint::kMagnitudeAt) >= 0, Refusal::kValueRange,
                      at + format::joint::kMagnitudeAt) &&
           require_at(load_i32(rate) >= kMinRate, Refusal::kValueRange, rate) &&
           require_at(load_i32(at + format::joint::kDeadBandAt) >= 0, Refusal::kValueRange,
                      at + format::joint::kDeadBandAt);
  });
}

bool Checker::check_tools() {
  return all_records(Section::kTools, [this](const std::uint8_t* at, std::size_t) {
    std::int64_t reach = reach_;  // each tool is added alone
    return check_transform(at, reach);
  });
}

bool Checker::is_revolute(std::size_t k) const {
  return record(Section::kJoints, k)[format::joint::kTypeAt] == 0U;
}

bool Checker::is_passive(std::size_t k) const {
  return (record(Section::kJoints, k)[format::joint::kFlagsAt] & format::joint::kPassive) != 0U;
}

bool Checker::check_coupling() {
  std::uint64_t taken = 0;  // a bit for each place
  std::array<std::int64_t, kMaxJoints> driven = {};
  return all_records(Section::kCoupling, [&](const std::uint8_t* at, std::size_t) {
    const std::uint8_t row = at[format::coupling::kRowAt];
    const std::uint8_t column = at[format::coupling::kColumnAt];
    const std::uint32_t place = 8U * row + column;
    const std::int64_t ratio = absolute(load_i32(at + format::coupling::kRatioAt));
    const bool passed =
        require_at(row < joints_ && column < joints_ && row != column, Refusal::kBadReference,
                   at) &&
        require_at(is_revolute(row) && is_revolute(column), Refusal::kBadReference, at) &&
        require_at(!is_passive(column), Refusal::kBadReference, at) &&
        require_zero(at + format::coupling::kReservedAt, 2) &&
        require_at(((taken >> place) & 1U) == 0U, Refusal::kBadReference, at) &&
        require_at(driven[column] + ratio <= kMaxDriven, Refusal::kValueRange,
                   at + format::coupling::kRatioAt);
    if (!passed) return false;
    driven[column] += ratio;
    taken |= std::uint64_t{1} << place;
    return true;
  });
}

bool Checker::check_sensors() {
  return all_records(Section::kSensors, [this](const std::uint8_t* at, std::size_t) {
    return require_at(load_i32(at) > -300000 && load_i32(at) < 1000000, Refusal::kValueRange, at);
  });
}

bool Checker::check_mass_sets() {
  return require_room(Section::kMassSets, kMaxMassSets) &&
         all_records(Section::kMassSets, [this](const std::uint8_t* at, std::size_t) {
           namespace set = format::mass_set;
           const std::uint8_t flags = at[set::kFlagsAt];
           const std::uint8_t most = (flags & set::kCarriesPayload) != 0U ? 30U : 60U;
           const std::uint8_t unlike_first = flags ^ record(Section::kMassSets, 0)[set::kFlagsAt];
           return require_at(at[set::kFractionAt] <= most, Refusal::kValueRange, at) &&
                  require_at(flags <= set::kAllFlags, Refusal::kUnknownFlag, at + 1) &&
                  require_at((unlike_first & set::kActsAtCommand) == 0U, Refusal::kValueRange,
                             at + 1) &&
                  require_zero(at + set::kReservedAt, 2);
         });
}

bool Checker::check_gravity() {
  const SectionView& gravity = section(Section::kGravity);
  if (gravity.count == 0U) return true;
  if (!require_at(gravity.count == 1U, Refusal::kTooManyRecords, gravity.begin)) return false;
  for (std::size_t i = 0; i < 3; ++i) {
    const std::uint8_t* at = gravity.begin + format::gravity::kPayloadPointAt + 4 * i;
    if (!require_at(absolute(load_i32(at)) <= kMaxPayloadArm, Refusal::kValueRange, at)) {
      return false;
    }
  }
  const std::uint8_t* limit = gravity.begin + format::gravity::kPayloadLimitAt;
  return require_at(load_i32(limit) >= 0, Refusal::kValueRange, limit);
}

}  // namespace armtrue
