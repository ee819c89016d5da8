#include "firmware/core/table_checks.h"

#include <array>

#include "firmware/core/bytes.h"
#include "firmware/core/fixed.h"
#include "firmware/core/format.h"
#include "firmware/core/limits.h"
#include "firmware/core/table_view.h"

namespace armtrue {
namespace {

namespace header = format::header;
using format::Section;

constexpr std::int64_t kMaxReach = std::int64_t{12} << Length::fraction;
constexpr std::int32_t kMaxPayloadArm = std::int32_t{4} << Length::fraction;
constexpr std::int32_t kMinDamping = std::int32_t{1} << (Length::fraction - 8);
constexpr std::int32_t kMaxDamping = std::int32_t{1} << Length::fraction;
constexpr std::int32_t kMinRotationLength = std::int32_t{1} << (Length::fraction - 5);
constexpr std::int32_t kMaxRotationLength = std::int32_t{1} << (Length::fraction + 1);
constexpr std::int64_t kMaxOffset = std::int64_t{8} << 32;
constexpr int kMaxShift = 62;
constexpr int kMaxSumShift = 31;
constexpr int kMaxCellShift = 30;
constexpr int kMaxPowerShift = 30;
constexpr std::int32_t kMaxPowerFraction = 60;
constexpr std::int64_t kMaxWave = std::int64_t{1} << 29;  // 0.125 rad or m
constexpr std::size_t kMaxOutputs = 8;
constexpr std::size_t kMaxGridNodes = 8192;

constexpr std::int64_t absolute(std::int64_t x) { return x < 0 ? -x : x; }

class Checker {
 public:
  explicit Checker(std::span<const std::uint8_t> body) : body_(body) {}

  Validation run() {
    const bool passed = check_header() && check_directory() && check_joints() && check_tools() &&
                        check_coupling() && check_sensors() && check_mass_sets() &&
                        check_gravity() && check_state() && check_nodes() && check_terms() &&
                        check_harmonics() && check_slow_waves();
    return passed ? Validation{} : failure_;
  }

 private:
  // Remembers why and where; `condition` is what a good image fulfils.
  bool require(bool condition, Refusal refusal, std::size_t field) {
    if (!condition) {
      failure_ = {refusal, static_cast<std::uint32_t>(field)};
    }
    return condition;
  }

  const SectionView& section(Section kind) const {
    return sections_[static_cast<std::size_t>(kind)];
  }
  std::size_t offset_of(const std::uint8_t* at) const {
    return static_cast<std::size_t>(at - body_.data());
  }
  const std::uint8_t* record(Section kind, std::size_t index) const {
    return section(kind).begin + index * record_length(kind, joints_);
  }
  bool require_at(bool condition, Refusal refusal, const std::uint8_t* at) {
    return require(condition, refusal, offset_of(at));
  }
  bool require_zero(const std::uint8_t* at, std::size_t bytes) {
    for (std::size_t i = 0; i < bytes; ++i) {
      if (!require_at(at[i] == 0U, Refusal::kReserved, at + i)) {
        return false;
      }
    }
    return true;
  }

  bool check_header() {
    const std::uint8_t* bytes = body_.data();
    joints_ = bytes[header::kJointCountAt];
    const bool counts =
        require(joints_ >= 1 && joints_ <= kMaxJoints, Refusal::kValueRange,
                header::kJointCountAt) &&
        require(bytes[header::kSensorCountAt] <= kMaxSensors, Refusal::kTooManyRecords,
                header::kSensorCountAt) &&
        require(bytes[header::kToolCountAt] >= 1 && bytes[header::kToolCountAt] <= kMaxTools,
                Refusal::kTooManyRecords, header::kToolCountAt) &&
        require(bytes[header::kActiveToolAt] < bytes[header::kToolCountAt], Refusal::kBadReference,
                header::kActiveToolAt) &&
        require(bytes[header::kReservedAt] == 0U, Refusal::kReserved, header::kReservedAt);
    if (!counts || !check_serial()) {
      return false;
    }
    const std::int32_t damping = load_i32(bytes + header::kDampingAt);
    const std::int32_t rotation = load_i32(bytes + header::kRotationLengthAt);
    const bool is_pose = (load_u32(bytes + header::kFlagsAt) & format::kFlagFullPose) != 0U;
    const bool rotation_fits =
        is_pose ? rotation >= kMinRotationLength && rotation <= kMaxRotationLength : rotation == 0;
    return require(damping >= kMinDamping && damping <= kMaxDamping, Refusal::kValueRange,
                   header::kDampingAt) &&
           require(rotation_fits, Refusal::kValueRange, header::kRotationLengthAt) &&
           require_zero(bytes + header::kReserved2At, 2);
  }

  // Printable ASCII, then zeros to the end.
  bool check_serial() {
    bool ended = false;
    for (std::size_t i = 0; i < kSerialLength; ++i) {
      const std::uint8_t c = body_[header::kSerialAt + i];
      ended = ended || c == 0U;
      const bool fits = ended ? c == 0U : c >= 0x20U && c < 0x7FU;
      if (!require(fits, Refusal::kValueRange, header::kSerialAt + i)) {
        return false;
      }
    }
    return true;
  }

  // Sections in the order of their kinds, without gaps, up to the end of the body.
  bool check_directory() {
    const std::size_t count = body_[header::kSectionCountAt];
    std::size_t expected = header::kLength + count * format::kDirectoryEntryLength;
    if (!require(expected <= body_.size(), Refusal::kSectionBounds, header::kSectionCountAt)) {
      return false;
    }
    std::uint16_t last_kind = 0;
    for (std::size_t i = 0; i < count; ++i) {
      const std::size_t entry = header::kLength + i * format::kDirectoryEntryLength;
      const std::uint16_t kind = load_u16(body_.data() + entry);
      const std::uint16_t records = load_u16(body_.data() + entry + 2);
      const std::uint32_t offset = load_u32(body_.data() + entry + 4);
      if (!require(kind != 0U && kind < format::kSectionKinds, Refusal::kUnknownSection, entry) ||
          !require(kind > last_kind, Refusal::kSectionBounds, entry) ||
          !require(records != 0U, Refusal::kSectionBounds, entry + 2) ||
          !require(offset == expected, Refusal::kSectionBounds, entry + 4)) {
        return false;
      }
      last_kind = kind;
      expected = offset + records * record_length(static_cast<Section>(kind), joints_);
      if (!require(expected <= body_.size(), Refusal::kSectionBounds, entry + 2)) {
        return false;
      }
      sections_[kind] = {body_.data() + offset, records};
    }
    const auto present = [this](Section kind) { return section(kind).count != 0U; };
    return require(expected == body_.size(), Refusal::kLength, header::kImageLengthAt) &&
           require(
               present(Section::kJoints) && present(Section::kTools) && present(Section::kState),
               Refusal::kMissingSection, header::kSectionCountAt) &&
           require(present(Section::kGravity) || !present(Section::kMassSets),
                   Refusal::kMissingSection, header::kSectionCountAt) &&
           require(section(Section::kJoints).count == joints_, Refusal::kJointCount,
                   header::kJointCountAt) &&
           require(section(Section::kTools).count == body_[header::kToolCountAt],
                   Refusal::kValueRange, header::kToolCountAt) &&
           require(section(Section::kSensors).count == body_[header::kSensorCountAt],
                   Refusal::kValueRange, header::kSensorCountAt) &&
           require(section(Section::kBase).count <= 1U, Refusal::kTooManyRecords,
                   header::kSectionCountAt);
  }

  // Rows of unit length; the translation's size is added to `reach`.
  bool check_transform(const std::uint8_t* at, std::int64_t& reach) {
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

  bool check_joints() {
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

  bool check_tools() {
    for (std::size_t i = 0; i < section(Section::kTools).count; ++i) {
      std::int64_t reach = reach_;  // one tool at a time
      if (!check_transform(record(Section::kTools, i), reach)) {
        return false;
      }
    }
    return true;
  }

  bool is_revolute(std::size_t k) const {
    return record(Section::kJoints, k)[format::joint::kTypeAt] == 0U;
  }

  bool check_coupling() {
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

  bool check_sensors() {
    for (std::size_t i = 0; i < section(Section::kSensors).count; ++i) {
      const std::uint8_t* at = record(Section::kSensors, i);
      if (!require_at(load_i32(at) > -300000 && load_i32(at) < 1000000, Refusal::kValueRange, at)) {
        return false;
      }
    }
    return true;
  }

  bool check_mass_sets() {
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

  bool check_gravity() {
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

  static int fixed_fraction(format::State kind) {
    switch (kind) {
      case format::State::kMotor:
      case format::State::kLink:
        return format::kPositionFraction;
      case format::State::kTemperature:
        return format::kTemperatureFraction;
      case format::State::kPayload:
        return format::kPayloadFraction;
      case format::State::kDirection:
        return format::kDirectionFraction;
      case format::State::kTime:
        return format::kTimeFraction;
      default:
        return Ratio::fraction;
    }
  }

  bool check_state() {
    const std::size_t count = section(Section::kState).count;
    if (!require(count <= kMaxSlots, Refusal::kTooManyRecords, header::kSectionCountAt)) {
      return false;
    }
    int last_class = format::kStillClass;
    for (std::size_t i = 0; i < count; ++i) {
      const std::uint8_t* at = record(Section::kState, i);
      if (!require_at(at[0] < format::kStateKinds, Refusal::kUnknownKind, at)) {
        return false;
      }
      const int kind_class = format::class_of(static_cast<format::State>(at[0]));
      if (!require_at(kind_class >= last_class, Refusal::kValueRange, at)) {
        return false;
      }
      last_class = kind_class;
      const auto kind = static_cast<format::State>(at[format::state::kKindAt]);
      const std::uint8_t index = at[format::state::kIndexAt];
      const std::uint8_t set = at[format::state::kSetAt];
      int fraction = fixed_fraction(kind);
      if (kind_class == format::kGravityClass) {
        if (!require_at(set < section(Section::kMassSets).count, Refusal::kBadReference, at + 2)) {
          return false;
        }
        fraction = record(Section::kMassSets, set)[format::mass_set::kFractionAt];
      } else if (!require_zero(at + format::state::kSetAt, 1)) {
        return false;
      }
      const bool names_nothing = kind == format::State::kOne || kind == format::State::kPayload ||
                                 kind == format::State::kTime ||
                                 kind == format::State::kBaseMomentX ||
                                 kind == format::State::kBaseMomentY;
      const std::size_t bound = names_nothing ? 1U
                                : kind == format::State::kTemperature
                                    ? section(Section::kSensors).count
                                    : joints_;
      if (!require_at(index < bound, Refusal::kBadReference, at + 1) ||
          !require_at(load_i8(at + format::state::kFractionAt) == fraction, Refusal::kValueRange,
                      at + 3) ||
          !require_at((kind == format::State::kOne) == (i == 0), Refusal::kUnknownKind, at)) {
        return false;
      }
    }
    return true;
  }

  // A slot that a record numbered `before` in slots may read; constant records only constant slots.
  bool check_slot(std::uint16_t slot, std::size_t before, bool constant, const std::uint8_t* at) {
    if (!require_at(slot < before, Refusal::kBadReference, at)) {
      return false;
    }
    if (!constant) {
      return true;
    }
    const std::size_t states = section(Section::kState).count;
    if (slot >= states) {
      return require_at(slot - states < constant_nodes_, Refusal::kBadReference, at);
    }
    const auto kind = static_cast<format::State>(record(Section::kState, slot)[0]);
    return require_at(format::class_of(kind) == format::kStillClass, Refusal::kBadReference, at);
  }

  bool check_angle_source(std::uint16_t source, bool constant, const std::uint8_t* at) {
    const std::size_t joint = source & 0xFFU;
    const std::uint16_t kind = source & 0xFF00U;
    return require_at(kind == 0U || kind == format::node::kLinkAngle, Refusal::kBadReference, at) &&
           require_at(joint < joints_ && is_revolute(joint) && !constant, Refusal::kBadReference,
                      at);
  }

  bool check_nodes() {
    namespace node = format::node;
    const std::size_t states = section(Section::kState).count;
    const std::size_t count = section(Section::kNodes).count;
    constant_nodes_ = load_u16(body_.data() + header::kConstantNodesAt);
    steep_nodes_ = load_u16(body_.data() + header::kSteepNodesAt);
    if (!require(states + count <= kMaxSlots, Refusal::kTooManyRecords, header::kSectionCountAt) ||
        !require(constant_nodes_ <= steep_nodes_, Refusal::kValueRange, header::kConstantNodesAt) ||
        !require(steep_nodes_ <= count, Refusal::kValueRange, header::kSteepNodesAt)) {
      return false;
    }
    std::size_t continued = 0;  // outputs of the last grid that are still to come
    for (std::size_t i = 0; i < count; ++i) {
      const std::uint8_t* at = record(Section::kNodes, i);
      if (!require_at(at[0] < format::kNodeKinds, Refusal::kUnknownKind, at)) {
        return false;
      }
      const auto kind = static_cast<format::Node>(at[node::kKindAt]);
      const bool is_continuation = kind == format::Node::kContinuation;
      if (!require_at(is_continuation == (continued != 0U), Refusal::kUnknownKind, at)) {
        return false;
      }
      if (is_continuation) {
        --continued;
        if (!require_zero(at, node::kLength)) {
          return false;
        }
        continue;
      }
      if (!check_node(at, kind, states + i, i < constant_nodes_, continued)) {
        return false;
      }
    }
    // A grid and its continuations stand in the same part of the list.
    const auto starts_whole = [this, count](std::size_t first) {
      return first == count || record(Section::kNodes, first)[node::kKindAt] != 0U;
    };
    return require(continued == 0U, Refusal::kSectionBounds, header::kSectionCountAt) &&
           require(starts_whole(constant_nodes_), Refusal::kValueRange, header::kConstantNodesAt) &&
           require(starts_whole(steep_nodes_), Refusal::kValueRange, header::kSteepNodesAt);
  }

  // Which fields of a node mean something; the others are zero.
  struct Fields {
    bool shift, shift2, count, a, b, p, r;
  };

  static Fields fields_of(format::Node kind) {
    switch (kind) {
      case format::Node::kHarmonic:
        return {false, false, false, true, false, true, true};
      case format::Node::kAngle:
        return {false, false, false, true, true, true, true};
      case format::Node::kToAngle:
      case format::Node::kScale:
        return {true, false, false, true, false, true, true};
      case format::Node::kSine:
        return {false, false, false, true, false, false, true};
      case format::Node::kProduct:
        return {false, false, false, true, true, false, false};
      case format::Node::kSum:
        return {true, true, false, true, true, false, false};
      case format::Node::kReciprocal:
        return {true, false, false, true, false, false, false};
      case format::Node::kAbsolute:
      case format::Node::kSign:
        return {false, false, false, true, false, false, false};
      case format::Node::kMinimum:
      case format::Node::kMaximum:
        return {false, false, false, true, true, false, false};
      case format::Node::kPowerOfTwo:
        return {true, false, false, true, false, true, false};
      case format::Node::kSpline:
        return {true, false, true, true, false, true, true};
      case format::Node::kGrid:
        return {false, false, true, false, false, false, true};
      case format::Node::kContinuation:
        break;
    }
    return {};
  }

  bool check_unused(const std::uint8_t* at, const Fields& used) {
    namespace node = format::node;
    return (used.shift || require_zero(at + node::kShiftAt, 1)) &&
           (used.shift2 || require_zero(at + node::kShift2At, 1)) &&
           (used.count || require_zero(at + node::kCountAt, 1)) &&
           (used.a || require_zero(at + node::kAAt, 2)) &&
           (used.b || require_zero(at + node::kBAt, 2)) &&
           (used.p || require_zero(at + node::kPAt, 4)) &&
           (used.r || require_zero(at + node::kRAt, 4));
  }

  bool check_shift(int shift, int low, int high, const std::uint8_t* at) {
    return require_at(shift >= low && shift <= high, Refusal::kValueRange, at);
  }

  bool check_node(const std::uint8_t* at, format::Node kind, std::size_t slot, bool constant,
                  std::size_t& continued) {
    namespace node = format::node;
    const Fields used = fields_of(kind);
    const std::uint8_t* a_at = at + node::kAAt;
    const std::uint8_t* b_at = at + node::kBAt;
    const std::uint16_t a = load_u16(a_at);
    const std::uint16_t b = load_u16(b_at);
    const int shift = load_i8(at + node::kShiftAt);
    if (!check_unused(at, used)) {
      return false;
    }
    if (kind == format::Node::kHarmonic || kind == format::Node::kAngle) {
      return check_angle_source(a, constant, a_at) &&
             (kind == format::Node::kHarmonic || b == node::kNone ||
              check_slot(b, slot, constant, b_at));
    }
    if (used.a && !check_slot(a, slot, constant, a_at)) {
      return false;
    }
    if (used.b && !check_slot(b, slot, constant, b_at)) {
      return false;
    }
    switch (kind) {
      case format::Node::kToAngle:
        return check_shift(shift, 1, kMaxShift, at + node::kShiftAt);
      case format::Node::kScale:
      case format::Node::kReciprocal:
        return check_shift(shift, 0, kMaxShift, at + node::kShiftAt);
      case format::Node::kSum:
        return check_shift(shift, -kMaxSumShift, kMaxSumShift, at + node::kShiftAt) &&
               check_shift(load_i8(at + node::kShift2At), -kMaxSumShift, kMaxSumShift,
                           at + node::kShift2At);
      case format::Node::kPowerOfTwo: {
        const std::int32_t fraction = load_i32(at + node::kPAt);
        return check_shift(shift, 0, kMaxPowerShift, at + node::kShiftAt) &&
               require_at(fraction >= -kMaxPowerFraction && fraction <= kMaxPowerFraction,
                          Refusal::kValueRange, at + node::kPAt);
      }
      case format::Node::kSpline:
        return check_spline(at, shift);
      case format::Node::kGrid:
        return check_grid(at, slot, constant, continued);
      default:
        return true;
    }
  }

  // A run of `length` bytes at data word `word`.
  bool check_data(std::int32_t word, std::size_t length, const std::uint8_t* at) {
    const std::size_t available = 4U * section(Section::kData).count;
    return require_at(word >= 0 && 4U * static_cast<std::size_t>(word) <= available &&
                          length <= available - 4U * static_cast<std::size_t>(word),
                      Refusal::kBadReference, at);
  }

  bool check_spline(const std::uint8_t* at, int shift) {
    const std::size_t cells = at[format::node::kCountAt];
    return check_shift(shift, 0, kMaxCellShift, at + format::node::kShiftAt) &&
           require_at(cells >= 1U, Refusal::kValueRange, at + format::node::kCountAt) &&
           check_data(load_i32(at + format::node::kRAt), cells * format::kSplineCellLength,
                      at + format::node::kRAt);
  }

  bool check_grid(const std::uint8_t* at, std::size_t slot, bool constant, std::size_t& continued) {
    namespace grid = format::grid;
    const std::uint8_t* reference = at + format::node::kRAt;
    const std::int32_t word = load_i32(reference);
    if (!check_data(word, grid::kHeadLength, reference)) {
      return false;
    }
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
    const std::size_t mask_length = 4U * ((nodes + 31U) / 32U);
    const std::size_t value_length = (2U * nodes * outputs + 3U) & ~std::size_t{3};
    if (!check_data(word, length + mask_length + value_length, reference)) {
      return false;
    }
    continued = outputs - 1U;
    return check_coverage(head + length, head + length + mask_length, nodes, outputs);
  }

  // Checks the axis at head + length and moves both sums past it.
  bool check_axis(std::int32_t word, const std::uint8_t* head, std::size_t slot, bool constant,
                  std::size_t& length, std::size_t& nodes) {
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
    length += grid::kAxisHeadLength + (is_explicit ? 8U * count - 4U : 8U);
    nodes *= count;
    if (!require_at(nodes <= kMaxGridNodes, Refusal::kTooManyRecords, head) ||
        !check_data(word, length, axis)) {
      return false;
    }
    const std::uint8_t* first = axis + grid::kAxisHeadLength;
    if (!is_explicit) {
      return require_at(load_u32(first + 4) != 0U, Refusal::kValueRange, first + 4);
    }
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

  // Nodes that are not covered hold zero, so that nothing needs to ask at run time.
  bool check_coverage(const std::uint8_t* mask, const std::uint8_t* values, std::size_t nodes,
                      std::size_t outputs) {
    for (std::size_t n = 0; n < nodes; ++n) {
      const bool is_covered = ((mask[n / 8U] >> (n % 8U)) & 1U) != 0U;
      for (std::size_t o = 0; o < outputs && !is_covered; ++o) {
        const std::uint8_t* value = values + 2U * (n * outputs + o);
        if (!require_at(load_i16(value) == 0, Refusal::kValueRange, value)) {
          return false;
        }
      }
    }
    return true;
  }

  bool is_known_coordinate(std::size_t coordinate) const {
    if (coordinate < format::kMotorCoordinates) {
      return coordinate < joints_;
    }
    const std::size_t frame = (coordinate - format::kMotorCoordinates) / 6U;
    return frame <= joints_ || frame == format::kToolFrame;
  }

  bool check_terms() {
    namespace term = format::term;
    const std::size_t count = section(Section::kTerms).count;
    const std::size_t states = section(Section::kState).count;
    const std::size_t slots = states + section(Section::kNodes).count;
    const std::size_t constant = load_u16(body_.data() + header::kConstantTermsAt);
    const std::size_t steep = load_u16(body_.data() + header::kSteepTermsAt);
    if (!require(count <= kMaxTerms, Refusal::kTooManyRecords, header::kSectionCountAt) ||
        !require(constant <= steep, Refusal::kValueRange, header::kConstantTermsAt) ||
        !require(steep <= count, Refusal::kValueRange, header::kSteepTermsAt)) {
      return false;
    }
    for (std::size_t i = 0; i < count; ++i) {
      const std::uint8_t* at = record(Section::kTerms, i);
      // Behind the constant ones stand the steep ones: on motor sides, and reading steep nodes at
      // most.
      const bool is_steep = i >= constant && i < steep;
      const bool in_place = !is_steep || at[term::kCoordinateAt] < format::kMotorCoordinates;
      const std::size_t readable = is_steep ? states + steep_nodes_ : slots;
      if (!require_at(is_known_coordinate(at[term::kCoordinateAt]), Refusal::kUnknownKind, at) ||
          !require_at(in_place, Refusal::kValueRange, at) ||
          !require_zero(at + term::kReservedAt, 1) ||
          !check_slot(load_u16(at + term::kSlotAt), readable, i < constant, at + term::kSlotAt)) {
        return false;
      }
    }
    return true;
  }

  bool check_harmonics() {
    namespace harmonic = format::harmonic;
    const std::size_t count = section(Section::kHarmonics).count;
    const std::size_t steep = load_u16(body_.data() + header::kSteepHarmonicsAt);
    if (!require(count <= kMaxHarmonics, Refusal::kTooManyRecords, header::kSectionCountAt) ||
        !require(steep <= count, Refusal::kValueRange, header::kSteepHarmonicsAt)) {
      return false;
    }
    for (std::size_t i = 0; i < count; ++i) {
      const std::uint8_t* at = record(Section::kHarmonics, i);
      const bool in_place = i >= steep || at[harmonic::kCoordinateAt] < format::kMotorCoordinates;
      if (!require_at(is_known_coordinate(at[harmonic::kCoordinateAt]), Refusal::kUnknownKind,
                      at) ||
          !require_at(in_place, Refusal::kValueRange, at) ||
          !require_zero(at + harmonic::kReservedAt, 1) ||
          !check_angle_source(load_u16(at + harmonic::kSourceAt), false,
                              at + harmonic::kSourceAt)) {
        return false;
      }
    }
    return true;
  }

  bool check_slow_waves() {
    namespace wave = format::slow_wave;
    const std::size_t count = section(Section::kSlowWaves).count;
    if (!require(count <= kMaxSlowWaves, Refusal::kTooManyRecords, header::kSectionCountAt)) {
      return false;
    }
    for (std::size_t i = 0; i < count; ++i) {
      const std::uint8_t* at = record(Section::kSlowWaves, i);
      const std::uint8_t joint = at[wave::kJointAt];
      if (!require_at(is_known_coordinate(at[wave::kCoordinateAt]), Refusal::kUnknownKind, at) ||
          !require_at(joint < joints_ && is_revolute(joint), Refusal::kBadReference,
                      at + wave::kJointAt) ||
          !require_zero(at + wave::kReservedAt, 2)) {
        return false;
      }
      for (std::size_t c = wave::kSineAt; c < wave::kLength; c += 4) {
        if (!require_at(absolute(load_i32(at + c)) <= kMaxWave, Refusal::kValueRange, at + c)) {
          return false;
        }
      }
    }
    return true;
  }

  std::span<const std::uint8_t> body_;
  std::size_t joints_ = 0;
  std::size_t constant_nodes_ = 0;
  std::size_t steep_nodes_ = 0;
  std::int64_t reach_ = 0;  // how far the links can stretch
  std::array<SectionView, format::kSectionKinds> sections_ = {};
  Validation failure_;
};

}  // namespace

Validation check_contents(std::span<const std::uint8_t> body) { return Checker(body).run(); }

}  // namespace armtrue
