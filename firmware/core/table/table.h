// A table image as the firmware sees it: validated once, then read in place.
//
// docs/table-format.md defines every bit. The image is neither copied nor written to; it must stay
// in place, unchanged, as long as a TableView of it is used.
#ifndef ARMTRUE_FIRMWARE_CORE_TABLE_TABLE_H_
#define ARMTRUE_FIRMWARE_CORE_TABLE_TABLE_H_

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include "firmware/core/table/limits.h"

namespace armtrue {

// Identity of this device and the key that it trusts. A table that does not match is refused.
struct DeviceIdentity {
  std::array<char, kSerialLength> robot_serial = {};  // zero padded; empty: not bound to a robot
  std::uint8_t joint_count = 0;                       // 0: tables of any number
  bool has_key = false;                               // with a key, only signed tables are taken
  std::array<std::uint8_t, 32> public_key = {};       // Ed25519 (RFC 8032)
};

// Why a table is refused. The numbers are shown on the bus: never renumber.
enum class Refusal : std::uint8_t {
  kNone = 0,
  kTooShort = 1,         // fewer bytes than a header
  kMagic = 2,            // not a table
  kNewerFormat = 3,      // a format version that this firmware does not know
  kLength = 4,           // the length in the header is not the length of the image
  kChecksum = 5,         // CRC-32
  kJointCount = 6,       // not this arm's number of joints
  kRobotSerial = 7,      // another robot's table
  kUnsigned = 8,         // this device has a key, the table has no signature
  kSignature = 9,        // signed with another key, or altered
  kUnknownFlag = 10,     // a header flag of a later format
  kUnknownSection = 11,  // a section kind of a later format
  kMissingSection = 12,  // a section that every table has is absent
  kSectionBounds = 13,   // a section reaches outside the image or overlaps the header
  kUnknownKind = 14,     // a state variable, node, coordinate or joint type of a later format
  kBadReference = 15,    // a record names a slot, joint, sensor, mass set or byte that is not there
  kValueRange = 16,      // a value outside what the format allows
  kReserved = 17,        // a reserved field that is not zero
  kTooManyRecords = 18,  // more than this firmware has room for (limits.h)
  kBusy = 19,            // an earlier activation is still pending
  kTooCostly = 20,       // a control cycle would take longer than kCycleBudget (table_cost.h)
  kScale = 21,           // increment scales that are not each other's inverse
  kResolution = 22,      // scales of drives with another resolution than this device's: 0x608F
};

// One short English name, for people and logs.
const char* name_of(Refusal refusal);

// The outcome of a validation. `field` is the byte offset in the image of the field at fault, so
// that a person with docs/table-format.md at hand can find it.
struct Validation {
  Refusal refusal = Refusal::kNone;
  std::uint32_t field = 0;

  constexpr bool accepted() const { return refusal == Refusal::kNone; }
};

// Checks the whole image: length, magic, version, CRC-32, identity, signature (if
// `device.has_key`), then every section and every record, so that nothing has to be checked again
// in the joint path. Takes time proportional to the image, plus one Ed25519 verification (tens of
// milliseconds on a Cortex-M4): never call it from the joint path.
Validation validate(std::span<const std::uint8_t> image, const DeviceIdentity& device);

// Identifies the export that produced an image. Shown in status objects, and compared so that an
// older table cannot be installed again (replay protection).
struct TableInfo {
  std::uint32_t sequence = 0;  // grows with every export for one robot
  std::uint32_t checksum = 0;  // CRC-32 of the image
};

// Precondition: `image` passed validate().
TableInfo describe(std::span<const std::uint8_t> image);

}  // namespace armtrue

#endif  // ARMTRUE_FIRMWARE_CORE_TABLE_TABLE_H_
