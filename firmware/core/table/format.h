// The layout of a table image in numbers: offsets, sizes, codes. docs/table-format.md explains
// them; host_tools/armtrue/tables/layout.py is the writer's side and is tested against this.
#ifndef ARMTRUE_FIRMWARE_CORE_TABLE_FORMAT_H_
#define ARMTRUE_FIRMWARE_CORE_TABLE_FORMAT_H_

#include <cstddef>
#include <cstdint>

namespace armtrue::format {

inline constexpr std::uint32_t kMagic = 0x4C425441;  // "ATBL"
inline constexpr std::uint16_t kVersion = 1;

namespace header {
inline constexpr std::size_t kMagicAt = 0;             // u32
inline constexpr std::size_t kVersionAt = 4;           // u16
inline constexpr std::size_t kHeaderLengthAt = 6;      // u16
inline constexpr std::size_t kImageLengthAt = 8;       // u32
inline constexpr std::size_t kFlagsAt = 12;            // u32
inline constexpr std::size_t kSequenceAt = 16;         // u32
inline constexpr std::size_t kJointCountAt = 20;       // u8
inline constexpr std::size_t kSensorCountAt = 21;      // u8
inline constexpr std::size_t kToolCountAt = 22;        // u8
inline constexpr std::size_t kSectionCountAt = 23;     // u8
inline constexpr std::size_t kSerialAt = 24;           // char[24]
inline constexpr std::size_t kFitDigestAt = 48;        // u8[32], SHA-256 of the fit
inline constexpr std::size_t kActiveToolAt = 80;       // u8
inline constexpr std::size_t kReservedAt = 81;         // u8
inline constexpr std::size_t kBlendAt = 82;            // u16, milliseconds
inline constexpr std::size_t kDampingAt = 84;          // u32, λ, 2^-27 m
inline constexpr std::size_t kRotationLengthAt = 88;   // u32, 2^-27 m per radian; 0: position only
inline constexpr std::size_t kConstantNodesAt = 92;    // u16
inline constexpr std::size_t kSteepNodesAt = 94;       // u16
inline constexpr std::size_t kConstantTermsAt = 96;    // u16
inline constexpr std::size_t kSteepTermsAt = 98;       // u16
inline constexpr std::size_t kSteepHarmonicsAt = 100;  // u16
inline constexpr std::size_t kReserved2At = 102;       // u16
inline constexpr std::size_t kLength = 104;
}  // namespace header

inline constexpr std::uint32_t kFlagSigned = 1U << 0;
inline constexpr std::uint32_t kFlagFullPose = 1U << 1;
inline constexpr std::uint32_t kKnownFlags = kFlagSigned | kFlagFullPose;

inline constexpr std::size_t kChecksumLength = 4;
inline constexpr std::size_t kSignatureLength = 64;

// Directory entry: u16 kind, u16 count, u32 offset.
inline constexpr std::size_t kDirectoryEntryLength = 8;

enum class Section : std::uint16_t {
  kJoints = 1,
  kTools = 2,
  kCoupling = 3,
  kState = 4,
  kSensors = 5,
  kMassSets = 6,
  kGravity = 7,
  kNodes = 8,
  kTerms = 9,
  kHarmonics = 10,
  kSlowWaves = 11,
  kData = 12,
  kBase = 13,  // measuring_from_base for host tools; a device skips it
};
inline constexpr std::size_t kSectionKinds = 14;

// Fixed transform: i32[9] rotation Q30 row by row, i32[3] translation Q27.
namespace transform {
inline constexpr std::size_t kTranslationAt = 36;
inline constexpr std::size_t kLength = 48;
}  // namespace transform

// Tool: last_link_from_tool, char[32] name.
namespace tool {
inline constexpr std::size_t kLength = 80;
}  // namespace tool

// Base: f64[9] rotation row by row, f64[3] translation.
namespace base {
inline constexpr std::size_t kLength = 96;
}  // namespace base

namespace joint {
inline constexpr std::size_t kTransformAt = 0;
inline constexpr std::size_t kOffsetAt = 48;            // i64, 2^-32 turn or metre
inline constexpr std::size_t kZeroAt = 56;              // i32, increments where q is zero
inline constexpr std::size_t kUnitPerIncrementAt = 60;  // i32 mantissa
inline constexpr std::size_t kIncrementPerUnitAt = 64;  // i32 mantissa
inline constexpr std::size_t kUnitShiftAt = 68;         // u8
inline constexpr std::size_t kIncrementShiftAt = 69;    // u8
inline constexpr std::size_t kTypeAt = 70;              // u8: 0 revolute, 1 prismatic
inline constexpr std::size_t kFlagsAt = 71;             // u8
inline constexpr std::size_t kMagnitudeAt = 72;         // i32, 2^-32 turn or metre
inline constexpr std::size_t kRateAt = 76;              // i32, 2^-32 turn or metre per second
inline constexpr std::size_t kDeadBandAt = 80;          // i32, increments
inline constexpr std::size_t kLength = 84;
// The joint has no drive: its link angle follows from the coupling section alone, and its position
// counts as zero.
inline constexpr std::uint8_t kPassive = 1U << 0;
inline constexpr std::uint8_t kAllFlags = kPassive;
}  // namespace joint

namespace coupling {
inline constexpr std::size_t kRowAt = 0;       // u8, the joint that is driven
inline constexpr std::size_t kColumnAt = 1;    // u8, the motor that also drives it
inline constexpr std::size_t kReservedAt = 2;  // u16
inline constexpr std::size_t kRatioAt = 4;     // i32 Q28
inline constexpr std::size_t kLength = 8;
inline constexpr int kRatioFraction = 28;
}  // namespace coupling

namespace state {
inline constexpr std::size_t kKindAt = 0;      // u8
inline constexpr std::size_t kIndexAt = 1;     // u8: joint or sensor, 0-based
inline constexpr std::size_t kSetAt = 2;       // u8: mass set
inline constexpr std::size_t kFractionAt = 3;  // i8
inline constexpr std::size_t kLength = 4;
}  // namespace state

enum class State : std::uint8_t {
  kOne = 0,      // 1, Q30; slot 0 of every table
  kMotor = 1,    // q, radian or metre, Q28
  kLink = 2,     // nominal link angle C q + offset, Q28
  kTorque = 3,   // of a mass set about the joint's axis, mapped by Cᵀ
  kMomentX = 4,  // of a mass set about the origin of the joint's frame
  kMomentY = 5,
  kBaseMomentX = 6,  // of a mass set about the base origin
  kBaseMomentY = 7,
  kTemperature = 8,  // difference from the sensor's reference, K, Q20
  kPayload = 9,      // kg, Q20
  kDirection = 10,   // -1, 0, +1, Q30
  kTime = 11,        // s, Q10
};
inline constexpr std::uint8_t kStateKinds = 12;
// Order of the state variables: those that are constant during a cycle, then joint positions, then
// gravity, set by set.
inline constexpr int kStillClass = 0;
inline constexpr int kPositionClass = 1;
inline constexpr int kGravityClass = 2;
constexpr int class_of(State kind) {
  if (kind == State::kMotor || kind == State::kLink) return kPositionClass;
  return kind >= State::kTorque && kind <= State::kBaseMomentY ? kGravityClass : kStillClass;
}
inline constexpr int kPositionFraction = 28;
inline constexpr int kTemperatureFraction = 20;
inline constexpr int kPayloadFraction = 20;
inline constexpr int kDirectionFraction = 30;
inline constexpr int kTimeFraction = 10;

namespace sensor {
inline constexpr std::size_t kReferenceAt = 0;  // i32, 0.001 °C
inline constexpr std::size_t kNameAt = 4;       // char[28]
inline constexpr std::size_t kLength = 32;
}  // namespace sensor

// Mass set: a head, then one record a joint.
namespace mass_set {
inline constexpr std::size_t kFractionAt = 0;  // u8, fraction bits of masses (kg), kg m and Nm
inline constexpr std::size_t kFlagsAt = 1;     // u8
inline constexpr std::size_t kReservedAt = 2;  // u16
inline constexpr std::size_t kHeadLength = 4;
inline constexpr std::size_t kLinkLength = 16;  // i32 mass, i32[3] mass times centre of mass
inline constexpr std::uint8_t kCarriesPayload = 1U << 0;
// Loads act at the corrected command instead of at the target; the same in all sets of a table.
inline constexpr std::uint8_t kActsAtCommand = 1U << 1;
inline constexpr std::uint8_t kAllFlags = kCarriesPayload | kActsAtCommand;
}  // namespace mass_set

namespace gravity {
inline constexpr std::size_t kVectorAt = 0;         // i32[3], m/s², Q27
inline constexpr std::size_t kPayloadPointAt = 12;  // i32[3], in the last link's frame, Q27
inline constexpr std::size_t kPayloadLimitAt = 24;  // i32, kg · 2^20; larger payloads saturate
inline constexpr std::size_t kLength = 28;
}  // namespace gravity

namespace node {
inline constexpr std::size_t kKindAt = 0;    // u8
inline constexpr std::size_t kShiftAt = 1;   // i8
inline constexpr std::size_t kShift2At = 2;  // i8
inline constexpr std::size_t kCountAt = 3;   // u8
inline constexpr std::size_t kAAt = 4;       // u16
inline constexpr std::size_t kBAt = 6;       // u16
inline constexpr std::size_t kPAt = 8;       // i32
inline constexpr std::size_t kRAt = 12;      // i32
inline constexpr std::size_t kLength = 16;
inline constexpr std::uint16_t kNone = 0xFFFF;
inline constexpr std::uint16_t kLinkAngle = 0x100;  // kHarmonic, kAngle: `a` is a link angle
inline constexpr int kOrderFraction = 20;
}  // namespace node

enum class Node : std::uint8_t {
  kContinuation = 0,  // further output of the grid before it
  kHarmonic = 1,      // sin(p · joint a + r), order p Q20
  kAngle = 2,         // angle p · joint a + r (+ slot b), order p Q20
  kToAngle = 3,       // angle slot a · p / 2^shift + r
  kSine = 4,          // sin(slot a + r), slot a an angle
  kProduct = 5,       // a · b / 2^32
  kSum = 6,           // a / 2^shift + b / 2^shift2
  kScale = 7,         // a · p / 2^shift + r
  kReciprocal = 8,    // 2^shift / a
  kAbsolute = 9,
  kSign = 10,  // -1, 0, +1, Q30
  kMinimum = 11,
  kMaximum = 12,
  kSpline = 13,      // piecewise cubic of slot a
  kGrid = 14,        // multilinear table of one or more slots
  kPowerOfTwo = 15,  // 2^(a / 2^shift), p fraction bits
};
inline constexpr std::uint8_t kNodeKinds = 16;

// Data of a spline, at word r: `count` cells of i32[4], coefficients of the powers of the position
// within the cell (0 … 1), with the fraction bits of the output. The first cell begins at p; cells
// are 2^shift wide.
inline constexpr std::size_t kSplineCellLength = 16;

// Data of a grid, at word r: a head, its axes, its coverage bits, its values.
namespace grid {
inline constexpr std::size_t kAxesAt = 0;      // u8
inline constexpr std::size_t kOutputsAt = 1;   // u8
inline constexpr std::size_t kReservedAt = 2;  // u16
inline constexpr std::size_t kHeadLength = 4;
// Axis: a head, then i32 first node and u32 inverse step (uniform), or i32[nodes] and u32[nodes-1]
// inverse steps (nodes listed).
inline constexpr std::size_t kAxisSlotAt = 0;      // u16
inline constexpr std::size_t kAxisNodesAt = 2;     // u16
inline constexpr std::size_t kAxisFlagsAt = 4;     // u8
inline constexpr std::size_t kAxisReservedAt = 5;  // u8[3]
inline constexpr std::size_t kAxisHeadLength = 8;
inline constexpr std::uint8_t kAxisExplicit = 1U << 0;  // nodes listed one by one
inline constexpr std::uint8_t kAxisHoldLow = 1U << 1;   // constant below the first node
inline constexpr std::uint8_t kAxisHoldHigh = 1U << 2;  // constant above the last node
inline constexpr std::uint8_t kAxisKnownFlags = kAxisExplicit | kAxisHoldLow | kAxisHoldHigh;
// Bytes of an axis after its head, and of the coverage bits.
constexpr std::size_t axis_length(std::size_t nodes, bool is_explicit) {
  return is_explicit ? 8U * nodes - 4U : 8U;
}
constexpr std::size_t mask_length(std::size_t nodes) { return 4U * ((nodes + 31U) / 32U); }
inline constexpr int kFraction = 20;       // of the position within a cell
inline constexpr int kValueFraction = 12;  // bits that interpolation adds below an int16 value
}  // namespace grid

// Term: coordinate += mantissa · slot / 2^32.
namespace term {
inline constexpr std::size_t kCoordinateAt = 0;  // u8
inline constexpr std::size_t kReservedAt = 1;    // u8
inline constexpr std::size_t kSlotAt = 2;        // u16
inline constexpr std::size_t kMantissaAt = 4;    // i32
inline constexpr std::size_t kLength = 8;
}  // namespace term

// Harmonic: coordinate += amplitude · sin(order · joint + phase) / 2^32, the sine Q30.
namespace harmonic {
inline constexpr std::size_t kCoordinateAt = 0;  // u8
inline constexpr std::size_t kReservedAt = 1;    // u8
inline constexpr std::size_t kSourceAt = 2;      // u16: joint, plus node::kLinkAngle
inline constexpr std::size_t kOrderAt = 4;       // i32 Q20
inline constexpr std::size_t kPhaseAt = 8;       // u32, binary angle
inline constexpr std::size_t kAmplitudeAt = 12;  // i32
inline constexpr std::size_t kLength = 16;
}  // namespace harmonic

// Slow wave: first and second harmonic of a link angle θ, whose sine and cosine are known from the
// chain: coordinate += (s1 sin θ + c1 cos θ + s2 sin 2θ + c2 cos 2θ) / 2^32, sines Q30.
namespace slow_wave {
inline constexpr std::size_t kCoordinateAt = 0;  // u8
inline constexpr std::size_t kJointAt = 1;       // u8
inline constexpr std::size_t kReservedAt = 2;    // u16
inline constexpr std::size_t kSineAt = 4;        // i32 s1
inline constexpr std::size_t kCosineAt = 8;      // i32 c1
inline constexpr std::size_t kSine2At = 12;      // i32 s2
inline constexpr std::size_t kCosine2At = 16;    // i32 c2
inline constexpr std::size_t kLength = 20;
}  // namespace slow_wave

// Coordinates: motor side of joint k (0-based) is k; axis c (tx ty tz rx ry rz) of the virtual
// joint f is 8 + 6 f + c, f = 0 the base, 1 … 8 the links, 9 the tool.
inline constexpr std::size_t kMotorCoordinates = 8;
inline constexpr std::size_t kFrames = 10;
inline constexpr std::size_t kToolFrame = 9;
inline constexpr std::size_t kToolCoordinates = kMotorCoordinates + 6 * kToolFrame;
inline constexpr std::size_t kCoordinates = kMotorCoordinates + 6 * kFrames;

}  // namespace armtrue::format

#endif  // ARMTRUE_FIRMWARE_CORE_TABLE_FORMAT_H_
