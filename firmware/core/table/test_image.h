// Builds table images section by section, for tests. Knows the layout from format.h only, so that
// it is a second writer, independent of host_tools/armtrue/tables.
#ifndef ARMTRUE_FIRMWARE_CORE_TABLE_TEST_IMAGE_H_
#define ARMTRUE_FIRMWARE_CORE_TABLE_TEST_IMAGE_H_

#include <array>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <map>
#include <string>
#include <vector>

#include "firmware/core/crypto/crc32.h"
#include "firmware/core/crypto/ed25519.h"
#include "firmware/core/table/format.h"
#include "firmware/core/table/limits.h"
#include "firmware/core/table/table_view.h"

namespace armtrue::tests {

// Joints of the tables here, and the resolution of their encoders: 2^24 increments a turn.
inline constexpr std::size_t kJoints = 3;
inline constexpr double kIncrementsPerRadian = 16777216.0 / (2.0 * M_PI);

using Bytes = std::vector<std::uint8_t>;

template <typename Integer>
void append(Bytes& bytes, Integer value) {
  for (std::size_t i = 0; i < sizeof value; ++i) {
    bytes.push_back(static_cast<std::uint8_t>(static_cast<std::uint64_t>(value) >> (8 * i)));
  }
}

template <typename Integer>
void put(Bytes& bytes, std::size_t at, Integer value) {
  for (std::size_t i = 0; i < sizeof value; ++i) {
    bytes[at + i] = static_cast<std::uint8_t>(static_cast<std::uint64_t>(value) >> (8 * i));
  }
}

inline std::int32_t fixed(double value, int fraction) {
  return static_cast<std::int32_t>(std::llround(std::ldexp(value, fraction)));
}

// A planar arm: joints about parallel z axes, each `link_m` beyond the last, in 2^24 increments a
// turn. Members may be changed before image() is called.
class TestImage {
 public:
  explicit TestImage(std::size_t joints = 3, double link_m = 0.5) : joints_(joints) {
    header_.resize(format::header::kLength);
    namespace header = format::header;
    put(header_, header::kMagicAt, format::kMagic);
    put(header_, header::kVersionAt, format::kVersion);
    put(header_, header::kHeaderLengthAt, static_cast<std::uint16_t>(header::kLength));
    header_[header::kJointCountAt] = static_cast<std::uint8_t>(joints);
    header_[header::kToolCountAt] = 1;
    put(header_, header::kBlendAt, std::uint16_t{100});
    put(header_, header::kDampingAt, fixed(0.02, 27));
    for (std::size_t k = 0; k < joints; ++k) {
      Bytes joint = transform(k == 0 ? 0.0 : link_m);
      append(joint, std::int64_t{0});        // offset
      append(joint, std::int32_t{0});        // zero
      append(joint, std::int32_t{1} << 30);  // unit per increment: 2^8, shift 22
      append(joint, std::int32_t{1} << 30);  // increment per unit: 2^-8, shift 38
      append(joint, std::uint8_t{22});
      append(joint, std::uint8_t{38});
      append(joint, std::uint16_t{0});  // revolute
      append(joint, kMaxDeltaRevolute);
      append(joint, kMaxRateRevolute);
      append(joint, std::int32_t{100});  // dead band
      add(format::Section::kJoints, joint);
    }
    Bytes tool = transform(link_m);
    tool.resize(format::tool::kLength);
    add(format::Section::kTools, tool);
    add_state(format::State::kOne, 0, 30);
  }

  void add(format::Section kind, const Bytes& record) {
    Bytes& section = sections_[static_cast<std::uint16_t>(kind)];
    section.insert(section.end(), record.begin(), record.end());
  }

  void add_state(format::State kind, std::uint8_t index, std::uint8_t fraction) {
    add(format::Section::kState, {static_cast<std::uint8_t>(kind), index, 0, fraction});
  }

  // coordinate += coefficient · slot / 2^fraction
  void add_term(std::uint8_t coordinate, std::uint16_t slot, double coefficient, int fraction) {
    Bytes term = {coordinate, 0};
    append(term, slot);
    append(term, fixed(coefficient, 62 - fraction));
    add(format::Section::kTerms, term);
  }

  // Constants come first and are counted.
  void add_constant(std::uint8_t coordinate, double value) {
    add_term(coordinate, 0, value, 30);
    constant_terms_ = static_cast<std::uint16_t>(constant_terms_ + 1);
  }

  void add_harmonic(std::uint8_t coordinate, std::uint16_t source, double order, double phase_turns,
                    double amplitude) {
    Bytes record = {coordinate, 0};
    append(record, source);
    append(record, fixed(order, 20));
    append(record, static_cast<std::uint32_t>(std::llround(std::ldexp(phase_turns, 32))));
    append(record, fixed(amplitude, 32));
    add(format::Section::kHarmonics, record);
  }

  // Adds a 1-D uniform table on a motor side over motor position `joint`, and its state variable.
  void add_table(std::uint8_t joint, double first, double step, const std::vector<double>& values,
                 int exponent, std::uint32_t covered = 0xFFFFFFFFU) {
    const auto slot = static_cast<std::uint16_t>(
        sections_[static_cast<std::uint16_t>(format::Section::kState)].size() /
        format::state::kLength);
    add_state(format::State::kMotor, joint, format::kPositionFraction);
    Bytes data = {1, 1, 0, 0};
    append(data, slot);
    append(data, static_cast<std::uint16_t>(values.size()));
    append(data, std::uint32_t{0});  // uniform, fades out
    append(data, fixed(first, format::kPositionFraction));
    append(data, static_cast<std::uint32_t>(std::llround(
                     std::ldexp(1.0, 52) / std::ldexp(step, format::kPositionFraction))));
    append(data, covered);
    for (std::size_t i = 0; i < values.size(); ++i) {
      append(data, static_cast<std::int16_t>(
                       (covered >> i) & 1U ? std::llround(std::ldexp(values[i], exponent)) : 0));
    }
    data.resize((data.size() + 3) / 4 * 4);
    const auto word = static_cast<std::int32_t>(
        sections_[static_cast<std::uint16_t>(format::Section::kData)].size() / 4);
    add(format::Section::kData, data);
    Bytes node = {static_cast<std::uint8_t>(format::Node::kGrid), 0, 0, 1, 0, 0, 0, 0, 0, 0, 0, 0};
    append(node, word);
    add(format::Section::kNodes, node);
    grid_terms_.push_back({joint, exponent});
  }

  Bytes& header() { return header_; }
  // Content of a section; the terms of add_table() are added only by image().
  Bytes& section(format::Section kind) { return sections_[static_cast<std::uint16_t>(kind)]; }

  void remove(format::Section kind) { sections_.erase(static_cast<std::uint16_t>(kind)); }

  // The image; with a seed it is signed.
  Bytes image(const std::array<std::uint8_t, 32>* seed = nullptr) {
    for (std::size_t i = 0; i < grid_terms_.size(); ++i) {
      const std::size_t states = section(format::Section::kState).size() / format::state::kLength;
      add_term(grid_terms_[i].joint, static_cast<std::uint16_t>(states + i), 1.0,
               grid_terms_[i].exponent + format::grid::kValueFraction);
    }
    grid_terms_.clear();
    Bytes bytes = header_;
    put(bytes, format::header::kConstantTermsAt, constant_terms_);
    put(bytes, format::header::kSteepTermsAt, constant_terms_);
    bytes[format::header::kSectionCountAt] = static_cast<std::uint8_t>(sections_.size());
    std::size_t offset = format::header::kLength + sections_.size() * format::kDirectoryEntryLength;
    for (const auto& [kind, content] : sections_) {
      const std::size_t length = record_length(static_cast<format::Section>(kind), joints_);
      append(bytes, kind);
      append(bytes, static_cast<std::uint16_t>(content.size() / length));
      append(bytes, static_cast<std::uint32_t>(offset));
      offset += content.size();
    }
    for (const auto& [kind, content] : sections_) {
      bytes.insert(bytes.end(), content.begin(), content.end());
    }
    const std::size_t trailer = seed == nullptr ? 4 : 68;
    put(bytes, format::header::kImageLengthAt, static_cast<std::uint32_t>(bytes.size() + trailer));
    if (seed != nullptr) {
      bytes[format::header::kFlagsAt] |= static_cast<std::uint8_t>(format::kFlagSigned);
      const auto signature = sign_ed25519(*seed, bytes);
      bytes.insert(bytes.end(), signature.begin(), signature.end());
    }
    append(bytes, crc32(bytes));
    return bytes;
  }

 private:
  struct GridTerm {
    std::uint8_t joint;
    int exponent;
  };

  static Bytes transform(double x_m) {
    Bytes bytes;
    for (int i = 0; i < 9; ++i) {
      append(bytes, i % 4 == 0 ? kRatioOne.raw : std::int32_t{0});
    }
    append(bytes, fixed(x_m, Length::fraction));
    append(bytes, std::int64_t{0});
    return bytes;
  }

  std::size_t joints_;
  Bytes header_;
  std::map<std::uint16_t, Bytes> sections_;
  std::vector<GridTerm> grid_terms_;
  std::uint16_t constant_terms_ = 0;
};

// Updates the checksum of a changed image.
inline void mend_checksum(Bytes& image) {
  put(image, image.size() - 4, crc32(std::span(image).first(image.size() - 4)));
}

}  // namespace armtrue::tests

#endif  // ARMTRUE_FIRMWARE_CORE_TABLE_TEST_IMAGE_H_
