// Gravity torques and moments of mass sets at nominal joint angles (docs/model.md, "State").
//
// A set has masses m_J and mass moments s_J = m_J · com_J in frame J. L_k is the first moment of
// everything beyond joint k, about the origin of frame k and in its axes. From the tool inwards
// L_{k-1} = s_{k-1} + R (L_k + M_k d) + M_k t, with R, t of F_k J_k, d the slide of joint k, M_k
// the mass beyond joint k. With gravity g_k in the same axes, the torque is L_k × g_k. This takes
// one pass outwards for g and one inwards for each set, about 25 multiplications per joint, and no
// frames.
#include "firmware/core/evaluation/terms.h"

namespace armtrue {
namespace {

struct Beyond {
  Vector moment;      // L_k, kg m with the fraction bits of its set
  std::int32_t mass;  // M_k
};
// Index k + 1 is what lies beyond joint k; index 0 is the whole arm about the base origin.
using BeyondAll = std::array<Beyond, kMaxJoints + 1>;
using GravityInFrames = std::array<Vector, kMaxJoints + 1>;  // m/s² Q27; index 0: the base

constexpr int kGravityFraction = 27;

void gravity_in_frames(const TableView& table, const JointMotions& motions,
                       GravityInFrames& gravity) {
  const std::uint8_t* at = table.section(format::Section::kGravity).begin;
  gravity[0] = {load_i32(at), load_i32(at + 4), load_i32(at + 8)};
  for (std::size_t k = 0; k < table.joint_count(); ++k) {
    gravity[k + 1] = rotate_back<narrow_roughly>(
        motions[k], rotate_back<narrow_roughly>(table.fixed(k), gravity[k]));
  }
}

// mass · length with the fraction bits of the mass, accurate to 32 units of the last place.
std::int32_t moment_of(std::int32_t mass, std::int32_t length) {
  const std::uint64_t wide = static_cast<std::uint64_t>(product(mass, length));
  return static_cast<std::int32_t>(static_cast<std::uint32_t>(wide >> 32U)
                                   << (32 - Length::fraction));
}

Vector moment_of(std::int32_t mass, const Vector& lever) {
  return {moment_of(mass, lever.x), moment_of(mass, lever.y), moment_of(mass, lever.z)};
}

// The payload's mass with the fraction bits of its set.
std::int32_t payload_mass(std::int32_t payload, int fraction) {
  const int up = fraction - format::kPayloadFraction;
  return saturate(up >= 0 ? product(payload, std::int32_t{1} << up) : round_shift(payload, -up));
}

void add_payload(const TableView& table, std::int32_t mass, Beyond& last) {
  const std::uint8_t* at =
      table.section(format::Section::kGravity).begin + format::gravity::kPayloadPointAt;
  last.moment =
      sum(last.moment, moment_of(mass, {load_i32(at), load_i32(at + 4), load_i32(at + 8)}));
  last.mass = wrapping_sum(last.mass, mass);
}

// The exporter chooses a set's fraction bits so that none of these sums exceeds 32 bits.
void sum_beyond(const TableView& table, const std::uint8_t* set, const JointMotions& motions,
                std::int32_t payload, BeyondAll& all) {
  const std::size_t joints = table.joint_count();
  Beyond carried = {};  // in the axes of frame k, about its origin, without link k
  for (std::size_t k = joints; k-- > 0;) {
    const std::uint8_t* link =
        set + format::mass_set::kHeadLength + k * format::mass_set::kLinkLength;
    Beyond& here = all[k + 1];
    here.moment =
        sum(carried.moment, {load_i32(link + 4), load_i32(link + 8), load_i32(link + 12)});
    here.mass = wrapping_sum(carried.mass, load_i32(link));
    if (k + 1 == joints &&
        (set[format::mass_set::kFlagsAt] & format::mass_set::kCarriesPayload) != 0U) {
      add_payload(table, payload_mass(payload, set[format::mass_set::kFractionAt]), here);
    }
    const FixedTransform fixed = table.fixed(k);
    Vector moment = rotate<narrow_roughly>(motions[k], here.moment);
    if (table.is_prismatic(k)) {
      moment.z = wrapping_sum(moment.z, moment_of(here.mass, motions[k].slide));
    }
    carried.moment =
        sum(rotate<narrow_roughly>(fixed, moment), moment_of(here.mass, fixed.translation()));
    carried.mass = here.mass;
  }
  all[0] = carried;
}

// Component of moment × gravity that `kind` asks for.
std::int32_t torque(const Vector& moment, const Vector& gravity, format::State kind) {
  const auto minor = [](std::int32_t a, std::int32_t b, std::int32_t c, std::int32_t d) {
    return rounded<kGravityFraction>(product(a, b) - product(c, d));
  };
  switch (kind) {
    case format::State::kMomentX:
    case format::State::kBaseMomentX:
      return minor(moment.y, gravity.z, moment.z, gravity.y);
    case format::State::kMomentY:
    case format::State::kBaseMomentY:
      return minor(moment.z, gravity.x, moment.x, gravity.z);
    default:
      return minor(moment.x, gravity.y, moment.y, gravity.x);
  }
}

// Torque (revolute) or force (prismatic) that gravity exerts along z of joint k.
std::int32_t link_torque(const TableView& table, const BeyondAll& all,
                         const GravityInFrames& gravity, std::size_t k) {
  if (table.is_prismatic(k)) return multiply<kGravityFraction>(all[k + 1].mass, gravity[k + 1].z);
  return torque(all[k + 1].moment, gravity[k + 1], format::State::kTorque);
}

// Virtual work: the torque on motor k is the sum of C_jk times the torque on link joint j.
std::int32_t motor_torque(const TableView& table, const BeyondAll& all,
                          const GravityInFrames& gravity, std::size_t k) {
  std::int64_t sum_of_links = link_torque(table, all, gravity, k);
  const SectionView& coupling = table.section(format::Section::kCoupling);
  for (std::size_t i = 0; i < coupling.count; ++i) {
    const std::uint8_t* entry = coupling.begin + i * format::coupling::kLength;
    if (entry[format::coupling::kColumnAt] == k) {
      const std::int32_t driven = link_torque(table, all, gravity, entry[format::coupling::kRowAt]);
      sum_of_links += round_shift(product(load_i32(entry + format::coupling::kRatioAt), driven),
                                  format::coupling::kRatioFraction);
    }
  }
  return saturate(sum_of_links);
}

}  // namespace

void update_gravity(const TableView& table, const JointMotions& motions, TermWorkspace& work) {
  const SectionView& state = table.section(format::Section::kState);
  if (table.first_gravity_state() == state.count) return;
  GravityInFrames gravity;
  gravity_in_frames(table, motions, gravity);
  BeyondAll all;
  std::size_t current_set = format::node::kNone;
  const std::uint8_t* variable = state.begin + table.first_gravity_state() * format::state::kLength;
  for (std::size_t i = table.first_gravity_state(); i < state.count; ++i) {
    const std::size_t set = variable[format::state::kSetAt];
    if (set != current_set) {
      sum_beyond(table, table.mass_set(set), motions, work.payload, all);
      current_set = set;
    }
    const std::size_t k = variable[format::state::kIndexAt];
    const auto kind = static_cast<format::State>(variable[format::state::kKindAt]);
    const bool is_base = kind >= format::State::kBaseMomentX;
    const std::size_t body = is_base ? 0U : k + 1U;
    work.slots[i] = kind == format::State::kTorque ? motor_torque(table, all, gravity, k)
                                                   : torque(all[body].moment, gravity[body], kind);
    variable += format::state::kLength;
  }
}

}  // namespace armtrue
