// Random tables that follow the format but have no physical meaning: every field at an end of its
// permitted range or anywhere within, references to any record that exists. One in four has some
// values beyond their range. A signature proves who made a table, not that it makes sense. A seed
// gives the same table on every platform.
#ifndef ARMTRUE_FIRMWARE_CORE_SENSELESS_SENSELESS_IMAGE_H_
#define ARMTRUE_FIRMWARE_CORE_SENSELESS_SENSELESS_IMAGE_H_

#include <cstdint>
#include <initializer_list>
#include <optional>
#include <random>

#include "firmware/core/table/test_image.h"

namespace armtrue::tests {

class SenselessImage {
 public:
  explicit SenselessImage(std::uint64_t seed) : random_(seed) {
    // A separate generator, so that the other tables are the same as before passive joints existed.
    if (std::mt19937_64 own(~seed); own() % 8U == 0U) passive_ = own() & ~std::uint64_t{1};
    make();
  }

  const Bytes& image() const { return image_; }
  std::uint8_t joints() const { return static_cast<std::uint8_t>(joints_); }

  // A 32-bit number, mostly an extreme: an end of the range, 0, ±1 or a power of two.
  std::int32_t extreme() {
    constexpr std::int32_t kMost = std::numeric_limits<std::int32_t>::max();
    switch (below(8)) {
      case 0:
        return kMost;
      case 1:
        return -kMost - 1;
      case 2:
        return 0;
      case 3:
        return once_in(2) ? 1 : -1;
      case 4:
        return std::int32_t{1} << below(31);
      case 5:
        return -(std::int32_t{1} << below(31));
      default:
        return static_cast<std::int32_t>(random_());
    }
  }

 private:
  std::uint64_t below(std::uint64_t end) { return random_() % end; }
  bool once_in(std::uint64_t times) { return below(times) == 0; }

  // An end of the range or a value within; in a disorderly table occasionally one beyond it.
  std::int64_t within(std::int64_t low, std::int64_t high) {
    if (is_disorderly_ && once_in(200)) return once_in(2) ? low - 1 : high + 1;
    switch (below(4)) {
      case 0:
        return low;
      case 1:
        return high;
      default:
        return low + static_cast<std::int64_t>(below(static_cast<std::uint64_t>(high - low) + 1U));
    }
  }
  template <typename Integer>
  Integer as(std::int64_t low, std::int64_t high) {
    return static_cast<Integer>(within(low, high));
  }
  std::size_t amount(std::size_t most) {
    const std::uint64_t much = once_in(6) ? most : (once_in(3) ? most / 6U : 6U);
    return static_cast<std::size_t>(below(std::min<std::uint64_t>(much, most) + 1U));
  }

  void make();
  void append_transform(Bytes& to, std::int64_t& reach);
  void append_joint(std::int64_t& reach);
  void append_scale(Bytes& to);
  void make_coupling();
  void make_masses();
  void make_states();
  void add_state(format::State kind, std::uint8_t index, std::uint8_t set, int fraction);
  void make_nodes();
  void append_node(std::size_t part);
  std::uint16_t slot(std::size_t part, std::size_t last_part_slot);
  std::optional<std::uint16_t> angle_source(std::size_t part);
  std::int32_t make_spline(std::uint8_t& cells);
  std::int32_t make_grid(std::size_t part, std::uint8_t& outputs);
  void append_axis(Bytes& to, std::size_t nodes, std::uint16_t slot);
  void make_terms();
  std::uint8_t coordinate(bool motor);
  Bytes& section(format::Section kind) { return sections_[static_cast<std::uint16_t>(kind)]; }
  void assemble();

  static constexpr std::size_t kConstant = 0;
  static constexpr std::size_t kSteep = 1;
  static constexpr std::size_t kSmooth = 2;

  std::mt19937_64 random_;
  bool is_disorderly_ = false;
  bool is_full_pose_ = false;
  std::size_t joints_ = 1;
  std::uint32_t prismatic_ = 0;
  std::uint64_t passive_ = 0;  // never joint 0
  std::size_t sensors_ = 0;
  std::size_t mass_sets_ = 0;
  std::vector<int> set_fractions_;
  std::size_t states_ = 0;
  std::size_t still_states_ = 0;
  std::size_t nodes_ = 0;
  std::array<std::size_t, 3> node_ends_ = {};  // of constant, steep, all
  std::array<std::size_t, 3> term_ends_ = {};
  std::size_t steep_harmonics_ = 0;
  std::map<std::uint16_t, Bytes> sections_;
  Bytes image_;
};

}  // namespace armtrue::tests

#endif  // ARMTRUE_FIRMWARE_CORE_SENSELESS_SENSELESS_IMAGE_H_
