// Settings of the device that test images measure between two buses in memory, and its slots in RAM
// with an active table.
#ifndef ARMTRUE_FIRMWARE_PORTS_STM32F405_CHECKS_INSTALLED_TABLE_H_
#define ARMTRUE_FIRMWARE_PORTS_STM32F405_CHECKS_INSTALLED_TABLE_H_

#include <array>
#include <cstdint>
#include <span>

#include "firmware/ports/common/device.h"
#include "firmware/storage/ram_flash.h"

namespace armtrue::checks {

inline constexpr std::uint32_t kJoints = 6;
inline constexpr std::uint8_t kNodeId = 32;

struct AcceptAll final : storage::TableVerifier {
  storage::TableVerdict verify(std::span<const std::uint8_t>) const override {
    return storage::TableVerdict::kAccepted;
  }
};

inline constexpr ports::DeviceSettings kSettings{
    .identity = {.robot_serial = {}, .joint_count = kJoints, .has_key = false, .public_key = {}},
    .node_id = kNodeId,
    .serial_number = 1,
    .cycle_us = 1000};

inline std::array<std::uint8_t, 2 * (kMaxImageLength + storage::kHeaderBytes)> table_memory;
inline std::array<std::uint8_t, 8 * 1024> parameter_memory;
inline storage::RamFlash table_flash(table_memory);
inline storage::RamFlash parameter_flash(parameter_memory);
alignas(4) inline std::array<std::uint8_t, kMaxImageLength> image;

// Stores `table` in the slots and activates it. False if they do not accept it.
inline bool install(std::span<const std::uint8_t> table) {
  const AcceptAll verifier;
  storage::SlotStore store(table_flash, verifier);  // no start(): the memory is all zeros
  std::span<const std::uint8_t> active;
  return store.commit(table) == storage::StoreResult::kDone &&
         store.activate(image, active) == storage::StoreResult::kDone &&
         store.confirm() == storage::StoreResult::kDone;
}

}  // namespace armtrue::checks

#endif  // ARMTRUE_FIRMWARE_PORTS_STM32F405_CHECKS_INSTALLED_TABLE_H_
