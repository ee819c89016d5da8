// The smallest real table that corrects every joint: delta of joint k is amplitude · sin(k's
// angle). For tests; docs/table-format.md explains the layout.
#ifndef ARMTRUE_FIRMWARE_TESTING_TEST_TABLE_H_
#define ARMTRUE_FIRMWARE_TESTING_TEST_TABLE_H_

#include <cmath>
#include <cstdint>
#include <cstring>
#include <string>
#include <vector>

#include "firmware/core/table/format.h"
#include "firmware/core/table/limits.h"
#include "firmware/core/table/test_image.h"

namespace armtrue::canopen {

struct TestTable {
  std::uint8_t joints = 6;
  std::uint32_t sequence = 1;
  std::string serial = "";
  std::int32_t amplitude = 1 << 22;  // of the correction
  std::int32_t magnitude = kMaxDeltaRevolute;
  std::int32_t rate = kMaxRateRevolute;
  std::uint16_t blend_ms = kMinBlendMilliseconds;
  std::uint8_t passive = 0;  // bit k: joint k has no drive, and joint 0 turns it back
  int finer = 0;             // the drives have 2^(20 + finer) increments a turn

  std::vector<std::uint8_t> image() const {
    using tests::put;
    tests::TestImage made(joints, 0.125);
    tests::Bytes& header = made.header();
    put(header, format::header::kSequenceAt, sequence);
    std::memcpy(&header[format::header::kSerialAt], serial.data(), serial.size());
    put(header, format::header::kBlendAt, blend_ms);
    for (std::uint8_t k = 0; k < joints; ++k) {
      tests::Bytes& records = made.section(format::Section::kJoints);
      const std::size_t at = k * format::joint::kLength;
      // 2^20 increments a turn: 2^12 units of 2^-32 turn each.
      records[at + format::joint::kUnitShiftAt] = static_cast<std::uint8_t>(18 + finer);
      records[at + format::joint::kIncrementShiftAt] = static_cast<std::uint8_t>(42 - finer);
      put(records, at + format::joint::kMagnitudeAt, magnitude);
      put(records, at + format::joint::kRateAt, rate);
      put(records, at + format::joint::kDeadBandAt, std::int32_t{0});
      if ((passive >> k & 1U) != 0) {
        records[at + format::joint::kFlagsAt] = format::joint::kPassive;
        tests::Bytes coupling = {k, 0, 0, 0};
        tests::append(coupling, -(std::int32_t{1} << format::coupling::kRatioFraction));
        made.add(format::Section::kCoupling, coupling);
        continue;
      }
      made.add_harmonic(k, k, 1.0, 0.0, std::ldexp(amplitude, -32));
    }
    return made.image();
  }
};

}  // namespace armtrue::canopen

#endif  // ARMTRUE_FIRMWARE_TESTING_TEST_TABLE_H_
