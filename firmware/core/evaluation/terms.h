// The term list: state variables, nodes and terms of a table, evaluated into coordinates.
#ifndef ARMTRUE_FIRMWARE_CORE_EVALUATION_TERMS_H_
#define ARMTRUE_FIRMWARE_CORE_EVALUATION_TERMS_H_

#include <array>
#include <cstdint>

#include "firmware/core/evaluation/kinematics.h"
#include "firmware/core/table/limits.h"
#include "firmware/core/table/table_view.h"

namespace armtrue {

// Inputs that the term list may read besides the joints.
struct Surroundings {
  // Difference from each sensor's reference, K · 2^20.
  std::array<std::int32_t, kMaxSensors> temperature_difference = {};
  std::int32_t payload = 0;                            // kg · 2^20
  std::int32_t time = 0;                               // s · 2^10
  std::array<std::int8_t, kMaxJoints> direction = {};  // -1, 0, +1
};

// Convert inputs from bus units to the units above; results saturate.
std::int32_t temperature_difference(std::int32_t milli_degc, std::int32_t reference_milli_degc);
std::int32_t payload_of_grams(std::int32_t gram);
std::int32_t time_of_milliseconds(std::uint64_t millisecond);

// Events of an evaluation that become cycle flags.
struct TermFlags {
  bool is_outside_coverage = false;
  bool is_saturated = false;
};

// Values of the slots, in the order of the state section and then of the nodes.
using Slots = std::array<std::int32_t, kMaxSlots>;

using MotorCoordinates = std::array<Coordinate, format::kMotorCoordinates>;

// Working memory of an evaluation; nothing in it outlives a cycle.
struct TermWorkspace {
  Slots slots = {};
  Coordinates constant = {};         // sum of the terms that do not depend on joints
  std::int32_t payload = 0;          // within the table's limit
  JointPositions no_positions = {};  // for nodes that read none
  TermFlags flags;
};

// Once a cycle: the state variables, nodes and terms that do not depend on the joints.
void begin_terms(const TableView& table, const Surroundings& surroundings, TermWorkspace& work);

// The state variables that depend on gravity, at nominal joint motions `motions` and work.payload.
void update_gravity(const TableView& table, const JointMotions& motions, TermWorkspace& work);

// Steep terms act on motor sides and change much within a correction (gear mesh, tables of joint
// errors). `steep` receives their sum for every motor. Also updates the state variables of joint
// positions, for steep and smooth terms.
void evaluate_steep_terms(const TableView& table, const JointPositions& motor,
                          const JointPositions& link, TermWorkspace& work, MotorCoordinates& steep);

// The sums of all other terms on every coordinate, at motor positions `motor` and link variables
// `link`, of which `motions` are the sines and cosines. Sums saturate at ±0.5 rad or m.
void evaluate_smooth_terms(const TableView& table, const JointPositions& motor,
                           const JointPositions& link, const JointMotions& motions,
                           TermWorkspace& work, Coordinates& coordinates);

}  // namespace armtrue

#endif  // ARMTRUE_FIRMWARE_CORE_EVALUATION_TERMS_H_
