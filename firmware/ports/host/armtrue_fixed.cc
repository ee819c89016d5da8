#include "firmware/ports/host/armtrue_fixed.h"

#include <algorithm>
#include <memory>
#include <span>

#include "firmware/core/compensator.h"
#include "firmware/core/crypto/ed25519.h"
#include "firmware/core/evaluation/inverse.h"
#include "firmware/core/table/table.h"
#include "firmware/core/table/table_cost.h"

namespace {

armtrue::Surroundings surroundings_of_row(const armtrue::TableView& table,
                                          const armtrue_surroundings& all, std::size_t row) {
  armtrue::Surroundings result;
  for (std::size_t s = 0; s < table.sensor_count() && all.temperature_difference != nullptr; ++s) {
    result.temperature_difference[s] = all.temperature_difference[row * table.sensor_count() + s];
  }
  result.payload = all.payload != nullptr ? all.payload[row] : 0;
  result.time = all.time != nullptr ? all.time[row] : 0;
  for (std::size_t k = 0; k < table.joint_count() && all.direction != nullptr; ++k) {
    result.direction[k] = all.direction[row * table.joint_count() + k];
  }
  return result;
}

armtrue::JointPositions target_of_row(const armtrue::TableView& table, const std::int64_t* target,
                                      std::size_t row) {
  armtrue::JointPositions result = {};
  for (std::size_t k = 0; k < table.joint_count(); ++k) {
    result[k].raw = target[row * table.joint_count() + k];
  }
  return result;
}

}  // namespace

std::int32_t armtrue_validate(const std::uint8_t* image, std::size_t length, const char* serial,
                              std::uint8_t joints, const std::uint8_t* public_key,
                              std::uint32_t* field) {
  armtrue::DeviceIdentity device;
  device.joint_count = joints;
  if (serial != nullptr) {
    std::copy_n(serial, device.robot_serial.size(), device.robot_serial.begin());
  }
  if (public_key != nullptr) {
    device.has_key = true;
    std::copy_n(public_key, device.public_key.size(), device.public_key.begin());
  }
  const armtrue::Validation validation = armtrue::validate({image, length}, device);
  *field = validation.field;
  return static_cast<std::int32_t>(validation.refusal);
}

std::uint32_t armtrue_cycle_cost(const std::uint8_t* image, std::size_t length) {
  return armtrue::cycle_cost({image, length});
}

std::uint32_t armtrue_cycle_budget() { return armtrue::kCycleBudget; }

const char* armtrue_refusal_name(std::int32_t refusal) {
  return armtrue::name_of(static_cast<armtrue::Refusal>(refusal));
}

void armtrue_solve(const std::uint8_t* image, std::size_t length, std::size_t rows,
                   const std::int64_t* target, const armtrue_surroundings* surroundings,
                   std::int32_t* delta, std::uint16_t* flags) {
  armtrue::TableView table(std::span(image, length));
  const auto workspace = std::make_unique<armtrue::Workspace>();
  const std::size_t joints = table.joint_count();
  armtrue::JointAmounts largest = {};
  for (std::size_t k = 0; k < joints; ++k) largest[k] = armtrue::largest_correction(table, k);
  for (std::size_t row = 0; row < rows; ++row) {
    if (surroundings->tool != nullptr) {
      table.choose_tool(surroundings->tool[row]);
    }
    armtrue::Correction correction =
        armtrue::solve(table, target_of_row(table, target, row),
                       surroundings_of_row(table, *surroundings, row), *workspace);
    unsigned row_flags = armtrue::kCycleClean;
    row_flags |= correction.is_near_singular ? armtrue::kNearSingular : armtrue::kCycleClean;
    row_flags |= correction.is_outside_coverage ? armtrue::kOutsideCoverage : armtrue::kCycleClean;
    row_flags |= correction.is_saturated ? armtrue::kStateSaturated : armtrue::kCycleClean;
    const std::uint32_t beyond = armtrue::scale_into_limits(largest, joints, correction.delta);
    row_flags |= beyond != 0U ? armtrue::kMagnitudeClamped : armtrue::kCycleClean;
    std::copy_n(correction.delta.begin(), joints, delta + row * joints);
    flags[row] = static_cast<std::uint16_t>(row_flags);
  }
}

void armtrue_coordinates(const std::uint8_t* image, std::size_t length, std::size_t rows,
                         const std::int64_t* target, const armtrue_surroundings* surroundings,
                         std::int32_t* coordinates) {
  const armtrue::TableView table(std::span(image, length));
  const auto workspace = std::make_unique<armtrue::Workspace>();
  for (std::size_t row = 0; row < rows; ++row) {
    const armtrue::JointPositions motor = target_of_row(table, target, row);
    const armtrue::Surroundings around = surroundings_of_row(table, *surroundings, row);
    armtrue::begin_terms(table, around, workspace->terms);
    armtrue::link_positions(table, motor, workspace->link);
    armtrue::joint_motions(table, workspace->link, workspace->motions);
    armtrue::update_gravity(table, workspace->motions, workspace->terms);
    armtrue::MotorCoordinates steep;
    armtrue::evaluate_steep_terms(table, motor, workspace->link, workspace->terms, steep);
    armtrue::evaluate_smooth_terms(table, motor, workspace->link, workspace->motions,
                                   workspace->terms, workspace->coordinates);
    for (std::size_t k = 0; k < table.joint_count(); ++k) {
      workspace->coordinates[k].raw += steep[k].raw;
    }
    for (std::size_t c = 0; c < workspace->coordinates.size(); ++c) {
      coordinates[row * workspace->coordinates.size() + c] = workspace->coordinates[c].raw;
    }
  }
}

void armtrue_ed25519_public_key(const std::uint8_t* seed, std::uint8_t* public_key) {
  const auto key = armtrue::public_key_ed25519(std::span<const std::uint8_t, 32>(seed, 32));
  std::copy(key.begin(), key.end(), public_key);
}

void armtrue_ed25519_sign(const std::uint8_t* seed, const std::uint8_t* message, std::size_t length,
                          std::uint8_t* signature) {
  const auto made =
      armtrue::sign_ed25519(std::span<const std::uint8_t, 32>(seed, 32), {message, length});
  std::copy(made.begin(), made.end(), signature);
}

std::int32_t armtrue_ed25519_verify(const std::uint8_t* signature, const std::uint8_t* public_key,
                                    const std::uint8_t* message, std::size_t length) {
  return armtrue::verify_ed25519(std::span<const std::uint8_t, 64>(signature, 64),
                                 std::span<const std::uint8_t, 32>(public_key, 32),
                                 {message, length})
             ? 1
             : 0;
}
