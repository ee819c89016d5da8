#include "firmware/core/table/table.h"

#include <algorithm>
#include <iterator>

#include "firmware/core/crypto/crc32.h"
#include "firmware/core/crypto/ed25519.h"
#include "firmware/core/fixed/bytes.h"
#include "firmware/core/table/format.h"
#include "firmware/core/table/table_checker.h"
#include "firmware/core/table/table_cost.h"

namespace armtrue {
namespace {

namespace header = format::header;

std::span<const std::uint8_t> without_trailer(std::span<const std::uint8_t> image, bool is_signed) {
  const std::size_t trailer = format::kChecksumLength + (is_signed ? format::kSignatureLength : 0U);
  return image.first(image.size() - trailer);
}

bool is_signed(std::span<const std::uint8_t> image) {
  return (load_u32(image.data() + header::kFlagsAt) & format::kFlagSigned) != 0U;
}

constexpr Validation refuse(Refusal refusal, std::size_t field) {
  return {refusal, static_cast<std::uint32_t>(field)};
}

// Checks that do not rely on the content of any byte after the header.
Validation check_envelope(std::span<const std::uint8_t> image) {
  if (image.size() < header::kLength + format::kChecksumLength) {
    return refuse(Refusal::kTooShort, image.size());
  }
  const std::uint8_t* bytes = image.data();
  if (load_u32(bytes + header::kMagicAt) != format::kMagic) {
    return refuse(Refusal::kMagic, header::kMagicAt);
  }
  if (load_u16(bytes + header::kVersionAt) != format::kVersion) {
    return refuse(Refusal::kNewerFormat, header::kVersionAt);
  }
  if (load_u16(bytes + header::kHeaderLengthAt) != header::kLength) {
    return refuse(Refusal::kNewerFormat, header::kHeaderLengthAt);
  }
  if (load_u32(bytes + header::kImageLengthAt) != image.size() || image.size() > kMaxImageLength) {
    return refuse(Refusal::kLength, header::kImageLengthAt);
  }
  if (is_signed(image) &&
      image.size() < header::kLength + format::kChecksumLength + format::kSignatureLength) {
    return refuse(Refusal::kTooShort, image.size());
  }
  const std::span<const std::uint8_t> checked = image.first(image.size() - format::kChecksumLength);
  if (crc32(checked) != load_u32(bytes + checked.size())) {
    return refuse(Refusal::kChecksum, checked.size());
  }
  const std::uint32_t flags = load_u32(bytes + header::kFlagsAt);
  if ((flags & ~format::kKnownFlags) != 0U) return refuse(Refusal::kUnknownFlag, header::kFlagsAt);
  return {};
}

Validation check_identity(std::span<const std::uint8_t> image, const DeviceIdentity& device) {
  const std::uint8_t* bytes = image.data();
  if (device.joint_count != 0U && bytes[header::kJointCountAt] != device.joint_count) {
    return refuse(Refusal::kJointCount, header::kJointCountAt);
  }
  const bool is_bound = device.robot_serial[0] != '\0';
  const auto same = [](char a, std::uint8_t b) { return static_cast<std::uint8_t>(a) == b; };
  if (is_bound && !std::equal(device.robot_serial.begin(), device.robot_serial.end(),
                              bytes + header::kSerialAt, same)) {
    return refuse(Refusal::kRobotSerial, header::kSerialAt);
  }
  if (device.has_key) {
    if (!is_signed(image)) return refuse(Refusal::kUnsigned, header::kFlagsAt);
    const std::span<const std::uint8_t> message = without_trailer(image, true);
    const auto signature = std::span<const std::uint8_t, format::kSignatureLength>(
        image.subspan(message.size(), format::kSignatureLength));
    if (!verify_ed25519(signature, device.public_key, message)) {
      return refuse(Refusal::kSignature, message.size());
    }
  }
  return {};
}

}  // namespace

Validation validate(std::span<const std::uint8_t> image, const DeviceIdentity& device) {
  Validation result = check_envelope(image);
  if (result.accepted()) {
    result = check_identity(image, device);
  }
  if (result.accepted()) {
    result = check_contents(without_trailer(image, is_signed(image)));
  }
  if (result.accepted() && cycle_cost(image) > kCycleBudget) {
    result = refuse(Refusal::kTooCostly, header::kSectionCountAt);
  }
  return result;
}

TableInfo describe(std::span<const std::uint8_t> image) {
  return {load_u32(image.data() + header::kSequenceAt),
          load_u32(image.data() + image.size() - format::kChecksumLength)};
}

const char* name_of(Refusal refusal) {
  static constexpr const char* kNames[] = {
      "accepted",                                          // kNone
      "too short",                                         // kTooShort
      "not a table",                                       // kMagic
      "unknown format version",                            // kNewerFormat
      "wrong length",                                      // kLength
      "wrong checksum",                                    // kChecksum
      "wrong number of joints",                            // kJointCount
      "another robot's table",                             // kRobotSerial
      "not signed",                                        // kUnsigned
      "wrong signature",                                   // kSignature
      "unknown flag",                                      // kUnknownFlag
      "unknown section",                                   // kUnknownSection
      "missing section",                                   // kMissingSection
      "section out of bounds",                             // kSectionBounds
      "unknown kind of record",                            // kUnknownKind
      "reference to nothing",                              // kBadReference
      "value out of range",                                // kValueRange
      "reserved field not zero",                           // kReserved
      "too many records",                                  // kTooManyRecords
      "activation pending",                                // kBusy
      "too much work for a control cycle",                 // kTooCostly
      "increment scales that do not fit each other",       // kScale
      "another resolution than the device's drives have",  // kResolution
  };
  const auto number = static_cast<std::size_t>(refusal);
  return number < std::size(kNames) ? kNames[number] : "unknown refusal";
}

}  // namespace armtrue
