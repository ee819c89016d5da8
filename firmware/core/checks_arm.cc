// The arm: joints and their drives, tools, coupling, sensors, masses.
#include "firmware/core/bytes.h"
#include "firmware/core/fixed.h"
#include "firmware/core/limits.h"
#include "firmware/core/table_checker.h"

namespace armtrue {
namespace {

namespace header = format::header;

constexpr std::int64_t kMaxReach = std::int64_t{12} << Length::fraction;
constexpr std::int32_t kMaxPayloadArm = std::int32_t{4} << Length::fraction;
constexpr std::int64_t kMaxOffset = std::int64_t{8} << 32;
constexpr int kMaxShift = 62;

}  // namespace

// Rows of unit length; the translation's size is added to `reach`.
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

bool Checker::check_joints() {
  for (std::size_t k = 0; k < joints_; ++k) {
    const std::uint8_t* at = record(Section::kJoints, k);
    const std::uint8_t unit_shift = at[format::joint::kUnitShiftAt];
    const std::uint8_t increment_shift = at[format::joint::kIncrementShiftAt];
    const bool passed =
        check_transform(at + format::joint::kTransformAt, reach_) &&
        require_at(absolute(load_i64(at + format::joint::kOffsetAt) >> 1) <= kMaxOffset / 2,
                   Refusal::kValueRange, at + format::joint::kOffsetAt) &&
        require_at(load_i32(at + format::joint::kUnitPerIncrementAt) != 0, Refusal::kValueRange,
                   at + format::joint::kUnitPerIncrementAt) &&
        require_at(load_i32(at + format::joint::kIncrementPerUnitAt) != 0, Refusal::kValueRange,
                   at + format::joint::kIncrementPerUnitAt) &&
        require_at(unit_shift >= 1U && unit_shift <= kMaxShift, Refusal::kValueRange,
                   at + format::joint::kUnitShiftAt) &&
        require_at(increment_shift >= 1U && increment_shift <= kMaxShift, Refusal::kValueRange,
                   at + format::joint::kIncrementShiftAt) &&
        require_at(at[format::joint::kTypeAt] <= 1U, Refusal::kUnknownKind,
                   at + format::joint::kTypeAt) &&
        require_zero(at + format::joint::kReservedAt, 1) &&
        require_at(load_i32(at + format::joint::kMagnitudeAt) >= 0, Refusal::kValueRange,
                   at + format::joint::kMagnitudeAt) &&
        require_at(load_i32(at + format::joint::kRateAt) >= 0, Refusal::kValueRange,
                   at + format::joint::kRateAt) &&
        require_at(load_i32(at + format::joint::kDeadBandAt) >= 0, Refusal::kValueRange,
                   at + format::joint::kDeadBandAt);
    if (!passed) {
      return false;
    }
  }
  return true;
}

bool Checker::check_tools() {
  for (std::size_t i = 0; i < section(Section::kTools).count; ++i) {
    std::int64_t reach = reach_;  // one tool at a time
    if (!check_transform(record(Section::kTools, i), reach)) {
      return false;
    }
  }
  return true;
}

bool Checker::is_revolute(std::size_t k) const {
  return record(Section::kJoints, k)[format::joint::kTypeAt] == 0U;
}

bool Checker::check_coupling() {
  for (std::size_t i = 0; i < section(Section::kCoupling).count; ++i) {
    const std::uint8_t* at = record(Section::kCoupling, i);
    const std::uint8_t row = at[format::coupling::kRowAt];
    const std::uint8_t column = at[format::coupling::kColumnAt];
    const bool passed =
        require_at(row < joints_ && column < joints_ && row != column, Refusal::kBadReference,
                   at) &&
        require_at(is_revolute(row) && is_revolute(column), Refusal::kBadReference, at) &&
        require_zero(at + format::coupling::kReservedAt, 2) &&
        require_at(i < kMaxJoints * kMaxJoints, Refusal::kTooManyRecords, at);
    if (!passed) {
      return false;
    }
  }
  return true;
}

bool Checker::check_sensors() {
  for (std::size_t i = 0; i < section(Section::kSensors).count; ++i) {
    const std::uint8_t* at = record(Section::kSensors, i);
    if (!require_at(load_i32(at) > -300000 && load_i32(at) < 1000000, Refusal::kValueRange, at)) {
      return false;
    }
  }
  return true;
}

bool Checker::check_mass_sets() {
  const std::size_t count = section(Section::kMassSets).count;
  if (!require(count <= kMaxMassSets, Refusal::kTooManyRecords, header::kSectionCountAt)) {
    return false;
  }
  for (std::size_t i = 0; i < count; ++i) {
    const std::uint8_t* at = record(Section::kMassSets, i);
    const std::uint8_t flags = at[format::mass_set::kFlagsAt];
    const std::uint8_t most = flags == format::mass_set::kCarriesPayload ? 30U : 60U;
    if (!require_at(at[format::mass_set::kFractionAt] <= most, Refusal::kValueRange, at) ||
        !require_at(flags <= format::mass_set::kCarriesPayload, Refusal::kUnknownFlag, at + 1) ||
        !require_zero(at + format::mass_set::kReservedAt, 2)) {
      return false;
    }
  }
  return true;
}

bool Checker::check_gravity() {
  const SectionView& gravity = section(Section::kGravity);
  if (gravity.count == 0U) {
    return true;
  }
  if (!require_at(gravity.count == 1U, Refusal::kTooManyRecords, gravity.begin)) {
    return false;
  }
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
