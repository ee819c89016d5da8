// The term list: state variables, nodes, terms, harmonics, slow waves.
#include "firmware/core/fixed/bytes.h"
#include "firmware/core/table/limits.h"
#include "firmware/core/table/table_checker.h"

namespace armtrue {
namespace {

namespace header = format::header;

constexpr int kMaxShift = 62;
constexpr int kMaxSumShift = 31;
constexpr int kMaxPowerShift = 30;
constexpr std::int32_t kMaxPowerFraction = 60;
constexpr std::int64_t kMaxWave = std::int64_t{1} << 29;  // 0.125 rad or m

// Fields that a node uses, by kind; the others must be zero.
enum NodeField : std::uint32_t {
  kShift = 1U << 0,
  kShift2 = 1U << 1,
  kCount = 1U << 2,
  kA = 1U << 3,
  kB = 1U << 4,
  kP = 1U << 5,
  kR = 1U << 6,
};
constexpr std::uint32_t kFieldsUsed[format::kNodeKinds] = {
    0,                               // kContinuation
    kA | kP | kR,                    // kHarmonic
    kA | kB | kP | kR,               // kAngle
    kShift | kA | kP | kR,           // kToAngle
    kA | kR,                         // kSine
    kA | kB,                         // kProduct
    kShift | kShift2 | kA | kB,      // kSum
    kShift | kA | kP | kR,           // kScale
    kShift | kA,                     // kReciprocal
    kA,                              // kAbsolute
    kA,                              // kSign
    kA | kB,                         // kMinimum
    kA | kB,                         // kMaximum
    kShift | kCount | kA | kP | kR,  // kSpline
    kCount | kR,                     // kGrid
    kShift | kA | kP,                // kPowerOfTwo
};

int fixed_fraction(format::State kind) {
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

}  // namespace

bool Checker::check_state() {
  int last_class = format::kStillClass;
  return require_room(Section::kState, kMaxSlots) &&
         all_records(Section::kState, [&](const std::uint8_t* at, std::size_t i) {
           return check_variable(at, i, last_class);
         });
}

bool Checker::check_variable(const std::uint8_t* at, std::size_t i, int& last_class) {
  const auto kind = static_cast<format::State>(at[format::state::kKindAt]);
  if (!require_at(at[0] < format::kStateKinds, Refusal::kUnknownKind, at) ||
      !require_at(format::class_of(kind) >= last_class, Refusal::kValueRange, at)) {
    return false;
  }
  last_class = format::class_of(kind);
  const std::uint8_t set = at[format::state::kSetAt];
  int fraction = fixed_fraction(kind);
  if (last_class == format::kGravityClass) {
    if (!require_at(set < section(Section::kMassSets).count, Refusal::kBadReference, at + 2)) {
      return false;
    }
    fraction = record(Section::kMassSets, set)[format::mass_set::kFractionAt];
  } else if (!require_zero(at + format::state::kSetAt, 1)) {
    return false;
  }
  const bool names_nothing = kind == format::State::kOne || kind == format::State::kPayload ||
                             kind == format::State::kTime || kind == format::State::kBaseMomentX ||
                             kind == format::State::kBaseMomentY;
  const std::size_t bound = names_nothing                         ? 1U
                            : kind == format::State::kTemperature ? section(Section::kSensors).count
                                                                  : joints_;
  return require_at(at[format::state::kIndexAt] < bound, Refusal::kBadReference, at + 1) &&
         require_at(load_i8(at + format::state::kFractionAt) == fraction, Refusal::kValueRange,
                    at + 3) &&
         require_at((kind == format::State::kOne) == (i == 0), Refusal::kUnknownKind, at);
}

// Checks that `slot` lies before slot `before` and, for a constant record, is constant.
bool Checker::check_slot(std::uint16_t slot, std::size_t before, bool constant,
                         const std::uint8_t* at) {
  if (!require_at(slot < before, Refusal::kBadReference, at)) return false;
  if (!constant) return true;
  const std::size_t states = section(Section::kState).count;
  if (slot >= states) {
    return require_at(slot - states < constant_nodes_, Refusal::kBadReference, at);
  }
  const auto kind = static_cast<format::State>(record(Section::kState, slot)[0]);
  return require_at(format::class_of(kind) == format::kStillClass, Refusal::kBadReference, at);
}

bool Checker::check_angle_source(std::uint16_t source, bool constant, const std::uint8_t* at) {
  const std::size_t joint = source & 0xFFU;
  const std::uint16_t kind = source & 0xFF00U;
  return require_at(kind == 0U || kind == format::node::kLinkAngle, Refusal::kBadReference, at) &&
         require_at(joint < joints_ && is_revolute(joint) && !constant, Refusal::kBadReference, at);
}

bool Checker::check_nodes() {
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
    if (!require_at(at[0] < format::kNodeKinds, Refusal::kUnknownKind, at)) return false;
    const auto kind = static_cast<format::Node>(at[node::kKindAt]);
    const bool is_continuation = kind == format::Node::kContinuation;
    if (!require_at(is_continuation == (continued != 0U), Refusal::kUnknownKind, at)) return false;
    if (is_continuation) {
      --continued;
      if (!require_zero(at, node::kLength)) return false;
      continue;
    }
    if (!check_node(at, kind, states + i, i < constant_nodes_, continued)) return false;
  }
  // A grid and its continuations must lie in the same part of the list.
  const auto starts_whole = [this, count](std::size_t first) {
    return first == count || record(Section::kNodes, first)[node::kKindAt] != 0U;
  };
  return require(continued == 0U, Refusal::kSectionBounds, header::kSectionCountAt) &&
         require(starts_whole(constant_nodes_), Refusal::kValueRange, header::kConstantNodesAt) &&
         require(starts_whole(steep_nodes_), Refusal::kValueRange, header::kSteepNodesAt);
}

bool Checker::check_unused(const std::uint8_t* at, std::uint32_t used) {
  namespace node = format::node;
  return ((used & kShift) != 0 || require_zero(at + node::kShiftAt, 1)) &&
         ((used & kShift2) != 0 || require_zero(at + node::kShift2At, 1)) &&
         ((used & kCount) != 0 || require_zero(at + node::kCountAt, 1)) &&
         ((used & kA) != 0 || require_zero(at + node::kAAt, 2)) &&
         ((used & kB) != 0 || require_zero(at + node::kBAt, 2)) &&
         ((used & kP) != 0 || require_zero(at + node::kPAt, 4)) &&
         ((used & kR) != 0 || require_zero(at + node::kRAt, 4));
}

bool Checker::check_shift(int shift, int low, int high, const std::uint8_t* at) {
  return require_at(shift >= low && shift <= high, Refusal::kValueRange, at);
}

bool Checker::check_node(const std::uint8_t* at, format::Node kind, std::size_t slot, bool constant,
                         std::size_t& continued) {
  namespace node = format::node;
  const std::uint32_t used = kFieldsUsed[static_cast<std::size_t>(kind)];
  const std::uint8_t* a_at = at + node::kAAt;
  const std::uint8_t* b_at = at + node::kBAt;
  const std::uint16_t a = load_u16(a_at);
  const std::uint16_t b = load_u16(b_at);
  const int shift = load_i8(at + node::kShiftAt);
  if (!check_unused(at, used)) return false;
  if (kind == format::Node::kHarmonic || kind == format::Node::kAngle) {
    return check_angle_source(a, constant, a_at) &&
           (kind == format::Node::kHarmonic || b == node::kNone ||
            check_slot(b, slot, constant, b_at));
  }
  if ((used & kA) != 0 && !check_slot(a, slot, constant, a_at)) return false;
  if ((used & kB) != 0 && !check_slot(b, slot, constant, b_at)) return false;
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

// Checks the coordinate, the first byte of a term, a harmonic or a slow wave. Steep records may act
// only on motor sides of joints that have a drive.
bool Checker::check_coordinate(const std::uint8_t* at, bool is_steep) {
  const std::size_t coordinate = *at;
  const bool is_motor = coordinate < format::kMotorCoordinates;
  const std::size_t frame = (coordinate - format::kMotorCoordinates) / 6U;
  const bool is_known =
      is_motor ? coordinate < joints_ : frame <= joints_ || frame == format::kToolFrame;
  return require_at(is_known, Refusal::kUnknownKind, at) &&
         require_at(!is_steep || (is_motor && !is_passive(coordinate)), Refusal::kValueRange, at);
}

bool Checker::check_terms() {
  namespace term = format::term;
  const std::size_t states = section(Section::kState).count;
  const std::size_t slots = states + section(Section::kNodes).count;
  const std::size_t constant = load_u16(body_.data() + header::kConstantTermsAt);
  const std::size_t steep = load_u16(body_.data() + header::kSteepTermsAt);
  return require_room(Section::kTerms, kMaxTerms) &&
         require(constant <= steep, Refusal::kValueRange, header::kConstantTermsAt) &&
         require(steep <= section(Section::kTerms).count, Refusal::kValueRange,
                 header::kSteepTermsAt) &&
         all_records(Section::kTerms, [&](const std::uint8_t* at, std::size_t i) {
           // Steep terms follow the constant ones; they act on motor sides and read only constant
           // and steep nodes.
           const bool is_steep = i >= constant && i < steep;
           const std::size_t readable = is_steep ? states + steep_nodes_ : slots;
           return check_coordinate(at, is_steep) && require_zero(at + term::kReservedAt, 1) &&
                  check_slot(load_u16(at + term::kSlotAt), readable, i < constant,
                             at + term::kSlotAt);
         });
}

bool Checker::check_harmonics() {
  namespace harmonic = format::harmonic;
  const std::size_t steep = load_u16(body_.data() + header::kSteepHarmonicsAt);
  return require_room(Section::kHarmonics, kMaxHarmonics) &&
         require(steep <= section(Section::kHarmonics).count, Refusal::kValueRange,
                 header::kSteepHarmonicsAt) &&
         all_records(Section::kHarmonics, [&](const std::uint8_t* at, std::size_t i) {
           return check_coordinate(at, i < steep) && require_zero(at + harmonic::kReservedAt, 1) &&
                  check_angle_source(load_u16(at + harmonic::kSourceAt), false,
                                     at + harmonic::kSourceAt);
         });
}

bool Checker::check_slow_waves() {
  namespace wave = format::slow_wave;
  return require_room(Section::kSlowWaves, kMaxSlowWaves) &&
         all_records(Section::kSlowWaves, [this](const std::uint8_t* at, std::size_t) {
           const std::uint8_t joint = at[wave::kJointAt];
           bool passed = check_coordinate(at, false) &&
                         require_at(joint < joints_ && is_revolute(joint), Refusal::kBadReference,
                                    at + wave::kJointAt) &&
                         require_zero(at + wave::kReservedAt, 2);
           for (std::size_t c = wave::kSineAt; passed && c < wave::kLength; c += 4) {
             passed =
                 require_at(absolute(load_i32(at + c)) <= kMaxWave, Refusal::kValueRange, at + c);
           }
           return passed;
         });
}

}  // namespace armtrue
