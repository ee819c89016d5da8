// SDO abort codes (CiA 301, table 22).
#ifndef ARMTRUE_FIRMWARE_CANOPEN_PROTOCOL_SDO_ABORT_H_
#define ARMTRUE_FIRMWARE_CANOPEN_PROTOCOL_SDO_ABORT_H_

#include <cstdint>

namespace armtrue::canopen {

enum class Abort : std::uint32_t {
  kNone = 0,
  kToggleBit = 0x05030000,
  kTimeOut = 0x05040000,
  kCommandSpecifier = 0x05040001,
  kBlockSize = 0x05040002,
  kSequenceNumber = 0x05040003,
  kCrc = 0x05040004,
  kOutOfMemory = 0x05040005,
  kUnsupportedAccess = 0x06010000,
  kWriteOnly = 0x06010001,
  kReadOnly = 0x06010002,
  kNoObject = 0x06020000,
  kNotMappable = 0x06040041,
  kPdoLength = 0x06040042,
  kIncompatibleParameter = 0x06040043,
  kHardware = 0x06060000,
  kLength = 0x06070010,
  kTooLong = 0x06070012,
  kTooShort = 0x06070013,
  kNoSubIndex = 0x06090011,
  kValueRange = 0x06090030,
  kValueTooHigh = 0x06090031,
  kValueTooLow = 0x06090032,
  kGeneral = 0x08000000,
  kCannotStore = 0x08000020,
  kDeviceState = 0x08000022,
  kNoData = 0x08000024,
};

}  // namespace armtrue::canopen

#endif  // ARMTRUE_FIRMWARE_CANOPEN_PROTOCOL_SDO_ABORT_H_
