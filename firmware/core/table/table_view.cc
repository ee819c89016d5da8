#include "firmware/core/table/table_view.h"

namespace armtrue {

TableView::TableView(std::span<const std::uint8_t> image) : image_(image) {
  namespace header = format::header;
  const std::uint8_t* bytes = image.data();
  joint_count_ = bytes[header::kJointCountAt];
  sensor_count_ = bytes[header::kSensorCountAt];
  is_full_pose_ = (load_u32(bytes + header::kFlagsAt) & format::kFlagFullPose) != 0U;
  blend_ms_ = load_u16(bytes + header::kBlendAt);
  damping_ = {load_i32(bytes + header::kDampingAt)};
  rotation_length_ = {load_i32(bytes + header::kRotationLengthAt)};
  constant_counts_ = {load_u16(bytes + header::kConstantNodesAt),
                      load_u16(bytes + header::kConstantTermsAt), 0};
  steep_counts_ = {load_u16(bytes + header::kSteepNodesAt), load_u16(bytes + header::kSteepTermsAt),
                   load_u16(bytes + header::kSteepHarmonicsAt)};

  const std::uint8_t* entry = bytes + header::kLength;
  for (std::size_t i = 0; i < bytes[header::kSectionCountAt]; ++i) {
    sections_[load_u16(entry)] = {bytes + load_u32(entry + 4), load_u16(entry + 2)};
    entry += format::kDirectoryEntryLength;
  }
  choose_tool(bytes[header::kActiveToolAt]);

  for (std::size_t k = 0; k < joint_count_; ++k) {
    const FixedTransform transform = {joint(k) + format::joint::kTransformAt, false};
    const bool is_about_x = transform.element(0, 0) == kRatioOne.raw &&
                            transform.element(0, 1) == 0 && transform.element(0, 2) == 0 &&
                            transform.element(1, 0) == 0 && transform.element(2, 0) == 0;
    const bool slides = joint(k)[format::joint::kTypeAt] != 0U;
    about_x_ = static_cast<std::uint8_t>(about_x_ | (is_about_x ? 1U << k : 0U));
    prismatic_ = static_cast<std::uint8_t>(prismatic_ | (slides ? 1U << k : 0U));
    const bool is_passive = (joint(k)[format::joint::kFlagsAt] & format::joint::kPassive) != 0U;
    passive_ = static_cast<std::uint8_t>(passive_ | (is_passive ? 1U << k : 0U));
  }
  read_motions();
  read_constants();

  do_loads_act_at_command_ = armtrue::do_loads_act_at_command(section(format::Section::kMassSets));

  const SectionView& state = section(format::Section::kState);
  for (std::size_t i = 0; i < state.count; ++i) {
    const int kind_class =
        format::class_of(static_cast<format::State>(state.begin[i * format::state::kLength]));
    const auto next = static_cast<std::uint16_t>(i + 1);
    if (kind_class == format::kStillClass) {
      first_position_state_ = next;
    }
    if (kind_class != format::kGravityClass) {
      first_gravity_state_ = next;
    }
  }
}

void TableView::read_motions() {
  for (const format::Section kind :
       {format::Section::kTerms, format::Section::kHarmonics, format::Section::kSlowWaves}) {
    const SectionView& records = section(kind);
    for (std::size_t i = 0; i < records.count; ++i) {
      // The coordinate is the first byte of all three.
      const std::uint8_t coordinate = records.begin[i * record_length(kind, joint_count_)];
      if (coordinate < format::kMotorCoordinates) continue;
      const std::size_t frame = (coordinate - format::kMotorCoordinates) / 6U;
      frames_in_use_ = static_cast<std::uint16_t>(frames_in_use_ | (1U << frame));
    }
  }
}

void TableView::read_constants() {
  // Terms of the constant 1 (slot 0), which come first.
  const SectionView& terms = section(format::Section::kTerms);
  const std::uint16_t constant_terms = constant_counts_.terms;
  while (first_changing_term_ < constant_terms) {
    const std::uint8_t* term = terms.begin + first_changing_term_ * format::term::kLength;
    if (load_u16(term + format::term::kSlotAt) != 0U) break;
    add_to(constants_[term[format::term::kCoordinateAt]],
           round_high(load_i32(term + format::term::kMantissaAt), kRatioOne.raw));
    ++first_changing_term_;
  }
  // Half of what second order may leave: the rest is for what changes.
  constexpr std::int32_t kLargeTurn = std::int32_t{1} << (Coordinate::fraction - 9);
  for (std::size_t frame = 0; frame < format::kFrames; ++frame) {
    for (std::size_t c = 3; c < 6; ++c) {
      const std::int32_t turn = constants_[format::kMotorCoordinates + 6 * frame + c].raw;
      if (turn > kLargeTurn || turn < -kLargeTurn) {
        large_turns_ = static_cast<std::uint16_t>(large_turns_ | (1U << frame));
      }
    }
  }
}

}  // namespace armtrue
