// Checks every field of a table's sections and records against what the joint path relies on.
//
// One class in four files: table_checks.cc (header, directory), checks_arm.cc (joints, tools,
// masses), checks_terms.cc (state variables, nodes, terms), checks_grid.cc (data of splines and
// grids).
#ifndef ARMTRUE_FIRMWARE_CORE_TABLE_TABLE_CHECKER_H_
#define ARMTRUE_FIRMWARE_CORE_TABLE_TABLE_CHECKER_H_

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include "firmware/core/table/format.h"
#include "firmware/core/table/table.h"
#include "firmware/core/table/table_view.h"

namespace armtrue {

constexpr std::int64_t absolute(std::int64_t x) { return x < 0 ? -x : x; }

class Checker {
 public:
  explicit Checker(std::span<const std::uint8_t> body) : body_(body) {}

  // Returns the first fault found, or acceptance.
  Validation run();

 private:
  using Section = format::Section;

  // Returns `condition`, which a valid image fulfils; if false, records refusal and field.
  bool require(bool condition, Refusal refusal, std::size_t field) {
    if (!condition) {
      failure_ = {refusal, static_cast<std::uint32_t>(field)};
    }
    return condition;
  }
  const SectionView& section(Section kind) const {
    return sections_[static_cast<std::size_t>(kind)];
  }
  std::size_t offset_of(const std::uint8_t* at) const {
    return static_cast<std::size_t>(at - body_.data());
  }
  const std::uint8_t* record(Section kind, std::size_t index) const {
    return section(kind).begin + index * record_length(kind, joints_);
  }
  bool require_at(bool condition, Refusal refusal, const std::uint8_t* at) {
    return require(condition, refusal, offset_of(at));
  }
  bool require_zero(const std::uint8_t* at, std::size_t bytes);
  bool require_room(Section kind, std::size_t most) {
    return require(section(kind).count <= most, Refusal::kTooManyRecords,
                   format::header::kSectionCountAt);
  }
  // True if every record of a section passes `check(at, index)`; stops at the first that fails.
  template <typename Check>
  bool all_records(Section kind, Check check) {
    for (std::size_t i = 0; i < section(kind).count; ++i) {
      if (!check(record(kind, i), i)) return false;
    }
    return true;
  }

  bool check_header();
  // The serial must be printable ASCII, then zeros to the end.
  bool check_serial();
  // Sections must be in the order of their kinds, without gaps, up to the end of the body.
  bool check_directory();

  // Checks that rows have unit length; adds the translation's size to `reach`.
  bool check_transform(const std::uint8_t* at, std::int64_t& reach);
  // The two increment scales of a joint.
  bool check_scale(const std::uint8_t* at);
  bool check_joints();
  bool check_tools();
  bool is_revolute(std::size_t k) const;
  bool is_passive(std::size_t k) const;
  bool check_coupling();
  bool check_sensors();
  bool check_mass_sets();
  bool check_gravity();

  bool check_state();
  bool check_variable(const std::uint8_t* at, std::size_t i, int& last_class);
  // Checks that `slot` lies before slot `before` and, for a constant record, is constant.
  bool check_slot(std::uint16_t slot, std::size_t before, bool constant, const std::uint8_t* at);
  bool check_angle_source(std::uint16_t source, bool constant, const std::uint8_t* at);
  bool check_nodes();
  bool check_unused(const std::uint8_t* at, std::uint32_t used);
  bool check_shift(int shift, int low, int high, const std::uint8_t* at);
  bool check_node(const std::uint8_t* at, format::Node kind, std::size_t slot, bool constant,
                  std::size_t& continued);
  bool check_coordinate(const std::uint8_t* at, bool is_steep);
  bool check_terms();
  bool check_harmonics();
  bool check_slow_waves();

  // Checks that `length` bytes from data word `word` on lie in the data section.
  bool check_data(std::int32_t word, std::size_t length, const std::uint8_t* at);
  bool check_spline(const std::uint8_t* at, int shift);
  bool check_grid(const std::uint8_t* at, std::size_t slot, bool constant, std::size_t& continued);
  // Checks the axis at head + length; adds its bytes to `length`, multiplies `nodes` by its nodes.
  bool check_axis(std::int32_t word, const std::uint8_t* head, std::size_t slot, bool constant,
                  std::size_t& length, std::size_t& nodes);
  // Nodes that are not covered must hold zero, so that interpolation needs no test at run time.
  bool check_coverage(const std::uint8_t* mask, const std::uint8_t* values, std::size_t nodes,
                      std::size_t outputs);

  std::span<const std::uint8_t> body_;
  std::size_t joints_ = 0;
  std::size_t constant_nodes_ = 0;
  std::size_t steep_nodes_ = 0;
  std::int64_t reach_ = 0;  // how far the links can stretch
  std::array<SectionView, format::kSectionKinds> sections_ = {};
  Validation failure_;
};

// Checks the header fields after the envelope, the directory, and every record of every section.
// `body`: the image without signature and checksum, at least as long as a header. An accepted body
// can be evaluated without any further check: no reference leaves its section, no shift its range.
Validation check_contents(std::span<const std::uint8_t> body);

}  // namespace armtrue

#endif  // ARMTRUE_FIRMWARE_CORE_TABLE_TABLE_CHECKER_H_
