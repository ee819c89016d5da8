// Access to the sections and fields of a validated image, for the joint path.
#ifndef ARMTRUE_FIRMWARE_CORE_TABLE_TABLE_VIEW_H_
#define ARMTRUE_FIRMWARE_CORE_TABLE_TABLE_VIEW_H_

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include "firmware/core/fixed/bytes.h"
#include "firmware/core/fixed/fixed.h"
#include "firmware/core/table/format.h"
#include "firmware/core/table/limits.h"
#include "firmware/core/table/linear.h"

namespace armtrue {

// A section of the image: its first byte and its number of records.
struct SectionView {
  const std::uint8_t* begin = nullptr;
  std::uint16_t count = 0;
};

// Numbers of records, counted from the first, up to the end of a part of the term list.
struct TermCounts {
  std::uint16_t nodes = 0;
  std::uint16_t terms = 0;
  std::uint16_t harmonics = 0;
};

// True if loads act at the corrected command: a flag that is the same in all mass sets.
inline bool do_loads_act_at_command(const SectionView& mass_sets) {
  return mass_sets.count != 0U &&
         (mass_sets.begin[format::mass_set::kFlagsAt] & format::mass_set::kActsAtCommand) != 0U;
}

// Pointers into a validated image, and the few header fields that the joint path needs. Reads need
// no further check. Precondition: validate() accepted the image.
class TableView {
 public:
  TableView() = default;
  explicit TableView(std::span<const std::uint8_t> image);

  std::uint8_t joint_count() const { return joint_count_; }
  std::uint8_t sensor_count() const { return sensor_count_; }
  bool is_full_pose() const { return is_full_pose_; }
  std::uint16_t blend_ms() const { return blend_ms_; }
  Length damping() const { return damping_; }                  // λ, metre per radian
  Length rotation_length() const { return rotation_length_; }  // metres that weigh as one radian
  // Nodes and terms that are constant during a cycle come first, then the steep ones.
  const TermCounts& constant_counts() const { return constant_counts_; }
  const TermCounts& steep_counts() const { return steep_counts_; }
  // The first state variable of joint positions, and the first of gravity, which follow them.
  std::uint16_t first_position_state() const { return first_position_state_; }
  std::uint16_t first_gravity_state() const { return first_gravity_state_; }
  // True where loads act at the corrected command, false where they act at the target.
  bool do_loads_act_at_command() const { return do_loads_act_at_command_; }
  std::span<const std::uint8_t> image() const { return image_; }

  const std::uint8_t* joint(std::size_t k) const {
    return section(format::Section::kJoints).begin + k * format::joint::kLength;
  }
  bool is_prismatic(std::size_t k) const { return ((prismatic_ >> k) & 1U) != 0U; }
  // Bit k: joint k has no drive.
  std::uint8_t passive() const { return passive_; }
  bool is_passive(std::size_t k) const { return ((passive_ >> k) & 1U) != 0U; }
  // F_k of joint k.
  FixedTransform fixed(std::size_t k) const {
    return {joint(k) + format::joint::kTransformAt, ((about_x_ >> k) & 1U) != 0U};
  }
  // last_link_from_tool of the chosen tool.
  FixedTransform tool() const { return {tool_, false}; }
  // Chooses a tool of the table; initially the one that the header names.
  void choose_tool(std::size_t index) {
    tool_ = section(format::Section::kTools).begin + index * format::tool::kLength;
  }
  const SectionView& section(format::Section kind) const {
    return sections_[static_cast<std::size_t>(kind)];
  }
  // True if some term acts on virtual joint `frame` (format::kFrames); the others are skipped.
  bool has_motion(std::size_t frame) const { return ((frames_in_use_ >> frame) & 1U) != 0U; }
  // True if the constant turn of virtual joint `frame` is beyond second order (linear.h).
  bool has_large_turn(std::size_t frame) const { return ((large_turns_ >> frame) & 1U) != 0U; }
  // Sum of the terms that never change, for every coordinate.
  const std::array<Coordinate, format::kCoordinates>& constants() const { return constants_; }
  // The first term that is not in constants().
  std::uint16_t first_changing_term() const { return first_changing_term_; }
  // The head of mass set `set`.
  const std::uint8_t* mass_set(std::size_t set) const {
    return section(format::Section::kMassSets).begin +
           set * (format::mass_set::kHeadLength + joint_count_ * format::mass_set::kLinkLength);
  }

 private:
  void read_motions();
  void read_constants();

  std::span<const std::uint8_t> image_;
  std::array<SectionView, format::kSectionKinds> sections_ = {};
  const std::uint8_t* tool_ = nullptr;
  Length damping_ = {};
  Length rotation_length_ = {};
  std::array<Coordinate, format::kCoordinates> constants_ = {};
  std::uint16_t first_changing_term_ = 0;
  std::uint16_t large_turns_ = 0;
  std::uint16_t frames_in_use_ = 0;
  std::uint8_t about_x_ = 0;    // bit k: F_k turns about x alone
  std::uint8_t prismatic_ = 0;  // bit k: joint k slides
  std::uint8_t passive_ = 0;
  std::uint16_t blend_ms_ = 0;
  TermCounts constant_counts_;
  TermCounts steep_counts_;
  std::uint16_t first_position_state_ = 0;
  std::uint16_t first_gravity_state_ = 0;
  std::uint8_t joint_count_ = 0;
  std::uint8_t sensor_count_ = 0;
  bool is_full_pose_ = false;
  bool do_loads_act_at_command_ = false;
};

// Bytes of one record of a section; mass sets depend on the number of joints, data is in words.
constexpr std::size_t record_length(format::Section kind, std::size_t joint_count) {
  switch (kind) {
    case format::Section::kJoints:
      return format::joint::kLength;
    case format::Section::kTools:
      return format::tool::kLength;
    case format::Section::kCoupling:
      return format::coupling::kLength;
    case format::Section::kState:
      return format::state::kLength;
    case format::Section::kSensors:
      return format::sensor::kLength;
    case format::Section::kMassSets:
      return format::mass_set::kHeadLength + joint_count * format::mass_set::kLinkLength;
    case format::Section::kGravity:
      return format::gravity::kLength;
    case format::Section::kNodes:
      return format::node::kLength;
    case format::Section::kTerms:
      return format::term::kLength;
    case format::Section::kHarmonics:
      return format::harmonic::kLength;
    case format::Section::kSlowWaves:
      return format::slow_wave::kLength;
    case format::Section::kData:
      return 4;
    case format::Section::kBase:
      return format::base::kLength;
  }
  return 0;
}

}  // namespace armtrue

#endif  // ARMTRUE_FIRMWARE_CORE_TABLE_TABLE_VIEW_H_
