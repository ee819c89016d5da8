// The smallest real table that corrects every joint: delta of joint k is amplitude · sin(k's
// angle). For tests; docs/table-format.md explains the layout.
#ifndef ARMTRUE_FIRMWARE_TESTING_TEST_TABLE_H_
#define ARMTRUE_FIRMWARE_TESTING_TEST_TABLE_H_

#include <cstdint>
#include <cstring>
#include <string>
#include <vector>

#include "firmware/canopen/protocol/little_endian.h"
#include "firmware/core/crypto/crc32.h"
#include "firmware/core/table/format.h"
#include "firmware/core/table/limits.h"
#include "firmware/core/table/table_view.h"

namespace armtrue::canopen {

struct TestTable {
  std::uint8_t joints = 6;
  std::uint32_t sequence = 1;
  std::string serial = "";
  std::int32_t amplitude = 1 << 22;  // of the correction
  std::int32_t magnitude = kMaxDeltaRevolute;
  std::int32_t rate = kMaxRateRevolute;
  std::uint16_t blend_ms = kMinBlendMilliseconds;
  int finer = 0;  // the drives have 2^(20 + finer) increments a turn

  std::vector<std::uint8_t> image() const {
    std::vector<std::uint8_t> bytes(format::header::kLength);
    namespace header = format::header;
    put(bytes, header::kMagicAt, format::kMagic);
    put(bytes, header::kVersionAt, format::kVersion);
    put(bytes, header::kHeaderLengthAt, static_cast<std::uint16_t>(header::kLength));
    put(bytes, header::kSequenceAt, sequence);
    bytes[header::kJointCountAt] = joints;
    bytes[header::kToolCountAt] = 1;
    bytes[header::kSectionCountAt] = kSections;
    std::memcpy(&bytes[header::kSerialAt], serial.data(), serial.size());
    put(bytes, header::kBlendAt, blend_ms);
    put(bytes, header::kDampingAt, std::uint32_t{1} << 24);
    std::size_t offset = header::kLength + kSections * format::kDirectoryEntryLength;
    const auto entry = [&](format::Section kind, std::size_t count) {
      append(bytes, static_cast<std::uint16_t>(kind));
      append(bytes, static_cast<std::uint16_t>(count));
      append(bytes, static_cast<std::uint32_t>(offset));
      offset += count * record_length(kind, joints);
    };
    entry(format::Section::kJoints, joints);
    entry(format::Section::kTools, 1);
    entry(format::Section::kState, 1);
    entry(format::Section::kHarmonics, joints);
    for (std::uint8_t k = 0; k < joints; ++k) append_joint(bytes);
    append_transform(bytes);
    bytes.resize(bytes.size() + format::tool::kLength - format::transform::kLength);  // no name
    append(bytes, std::uint32_t{30} << 24);  // slot 0: one, fraction 30
    for (std::uint8_t k = 0; k < joints; ++k) append_harmonic(bytes, k);
    put(bytes, header::kImageLengthAt, static_cast<std::uint32_t>(bytes.size() + 4));
    append(bytes, crc32(bytes));
    return bytes;
  }

 private:
  static constexpr std::uint8_t kSections = 4;

  template <typename T>
  static void put(std::vector<std::uint8_t>& bytes, std::size_t at, T value) {
    store_le(&bytes[at], value);
  }
  template <typename T>
  static void append(std::vector<std::uint8_t>& bytes, T value) {
    bytes.resize(bytes.size() + sizeof(T));
    store_le(&bytes[bytes.size() - sizeof(T)], value);
  }
  static void append_transform(std::vector<std::uint8_t>& bytes) {
    for (int element = 0; element < 9; ++element) {
      append(bytes, element % 4 == 0 ? std::int32_t{1} << 30 : std::int32_t{0});
    }
    for (int axis = 0; axis < 3; ++axis) append(bytes, std::int32_t{1} << 24);  // 0.125 m
  }
  void append_joint(std::vector<std::uint8_t>& bytes) const {
    const std::size_t begin = bytes.size();
    append_transform(bytes);
    bytes.resize(begin + format::joint::kLength);
    // 2^20 increments a turn: 2^12 units of 2^-32 turn each.
    put(bytes, begin + format::joint::kUnitPerIncrementAt, std::int32_t{1} << 30);
    put(bytes, begin + format::joint::kIncrementPerUnitAt, std::int32_t{1} << 30);
    bytes[begin + format::joint::kUnitShiftAt] = static_cast<std::uint8_t>(18 + finer);
    bytes[begin + format::joint::kIncrementShiftAt] = static_cast<std::uint8_t>(42 - finer);
    put(bytes, begin + format::joint::kMagnitudeAt, magnitude);
    put(bytes, begin + format::joint::kRateAt, rate);
  }
  void append_harmonic(std::vector<std::uint8_t>& bytes, std::uint8_t joint) const {
    const std::size_t begin = bytes.size();
    bytes.resize(begin + format::harmonic::kLength);
    bytes[begin + format::harmonic::kCoordinateAt] = joint;
    put(bytes, begin + format::harmonic::kSourceAt, static_cast<std::uint16_t>(joint));
    put(bytes, begin + format::harmonic::kOrderAt, std::int32_t{1} << format::node::kOrderFraction);
    put(bytes, begin + format::harmonic::kAmplitudeAt, amplitude);
  }
};

}  // namespace armtrue::canopen

#endif  // ARMTRUE_FIRMWARE_TESTING_TEST_TABLE_H_
