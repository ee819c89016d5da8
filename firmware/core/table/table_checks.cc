#include "firmware/core/fixed/bytes.h"
#include "firmware/core/table/limits.h"
#include "firmware/core/table/table_checker.h"

namespace armtrue {
namespace {

namespace header = format::header;
constexpr std::int32_t kMinDamping = std::int32_t{1} << (Length::fraction - 8);
constexpr std::int32_t kMaxDamping = std::int32_t{1} << Length::fraction;
constexpr std::int32_t kMinRotationLength = std::int32_t{1} << (Length::fraction - 5);
constexpr std::int32_t kMaxRotationLength = std::int32_t{1} << (Length::fraction + 1);

}  // namespace

Validation Checker::run() {
  const bool passed = check_header() && check_directory() && check_joints() && check_tools() &&
                      check_coupling() && check_sensors() && check_mass_sets() && check_gravity() &&
                      check_state() && check_nodes() && check_terms() && check_harmonics() &&
                      check_slow_waves();
  return passed ? Validation{} : failure_;
}

bool Checker::require_zero(const std::uint8_t* at, std::size_t bytes) {
  for (std::size_t i = 0; i < bytes; ++i) {
    if (!require_at(at[i] == 0U, Refusal::kReserved, at + i)) return false;
  }
  return true;
}

bool Checker::check_header() {
  const std::uint8_t* bytes = body_.data();
  joints_ = bytes[header::kJointCountAt];
  const bool counts =
      require(joints_ >= 1 && joints_ <= kMaxJoints, Refusal::kValueRange, header::kJointCountAt) &&
      require(bytes[header::kSensorCountAt] <= kMaxSensors, Refusal::kTooManyRecords,
              header::kSensorCountAt) &&
      require(bytes[header::kToolCountAt] >= 1 && bytes[header::kToolCountAt] <= kMaxTools,
              Refusal::kTooManyRecords, header::kToolCountAt) &&
      require(bytes[header::kActiveToolAt] < bytes[header::kToolCountAt], Refusal::kBadReference,
              header::kActiveToolAt) &&
      require(bytes[header::kReservedAt] == 0U, Refusal::kReserved, header::kReservedAt);
  if (!counts || !check_serial()) return false;
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

// The serial must be printable ASCII, then zeros to the end.
bool Checker::check_serial() {
  bool ended = false;
  for (std::size_t i = 0; i < kSerialLength; ++i) {
    const std::uint8_t c = body_[header::kSerialAt + i];
    ended = ended || c == 0U;
    const bool fits = ended ? c == 0U : c >= 0x20U && c < 0x7FU;
    if (!require(fits, Refusal::kValueRange, header::kSerialAt + i)) return false;
  }
  return true;
}

// Sections must be in the order of their kinds, without gaps, up to the end of the body.
bool Checker::check_directory() {
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
    if (!require(expected <= body_.size(), Refusal::kSectionBounds, entry + 2)) return false;
    sections_[kind] = {body_.data() + offset, records};
  }
  const auto present = [this](Section kind) { return section(kind).count != 0U; };
  return require(expected == body_.size(), Refusal::kLength, header::kImageLengthAt) &&
         require(present(Section::kJoints) && present(Section::kTools) && present(Section::kState),
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

Validation check_contents(std::span<const std::uint8_t> body) { return Checker(body).run(); }

}  // namespace armtrue
