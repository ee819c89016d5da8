// All parts of a compensator above its drivers. One static object per bare-metal image; on POSIX
// one object from each power-on or reset to the next.
#ifndef ARMTRUE_FIRMWARE_PORTS_COMMON_DEVICE_H_
#define ARMTRUE_FIRMWARE_PORTS_COMMON_DEVICE_H_

#include <array>
#include <cstdint>

#include "firmware/canopen/node/node.h"
#include "firmware/canopen/table/table_transfer.h"
#include "firmware/core/compensator.h"
#include "firmware/core/table/limits.h"
#include "firmware/storage/flash.h"
#include "firmware/storage/slot_store.h"

namespace armtrue::ports {

// Drivers and functions that a port provides to the device; none is owned.
struct DeviceParts {
  canopen::CanPort& upstream;
  canopen::CanPort* downstream;  // nullptr: offset mode on one bus
  storage::Flash& tables;
  canopen::ParameterStore& parameters;
  std::uint64_t (*clock_us)();
  const canopen::PortHealth* health = nullptr;
  void (*note_long_request)(bool begins) = nullptr;  // canopen::NodeParts
};

// Settings fixed when the image is built (firmware/ports/identity.cmake) or by the command line.
// Must outlive the device.
struct DeviceSettings {
  DeviceIdentity identity;  // with the arm's number of joints
  std::uint8_t node_id = 0;
  std::uint32_t serial_number = 0;  // 0x1018 sub 4
  std::uint32_t cycle_us = 0;
};

class Device {
 public:
  Device(const DeviceSettings& settings, const DeviceParts& parts)
      : clock_us_(parts.clock_us),
        compensator_({.joint_count = settings.identity.joint_count, .cycle_us = settings.cycle_us}),
        verifier_(settings.identity),
        store_(parts.tables, verifier_),
        node_({.node_id = settings.node_id,
               .serial_number = settings.serial_number,
               .joint_count = settings.identity.joint_count,
               .clock_us = parts.clock_us},
              {parts.upstream,
               parts.downstream,
               compensator_,
               store_,
               parts.parameters,
               settings.identity,
               {first_, second_},
               parts.health,
               parts.note_long_request}) {}

  // Activates the stored table. Erases nothing, so that a device that is reset while its drives run
  // forwards frames again at once.
  void start() { node_.start(clock_us_()); }

  // One iteration of the main loop. Calls `feed_watchdog` only if the joint path is sound.
  // Returns false if the master requested a restart.
  template <typename FeedWatchdog>
  bool turn(FeedWatchdog feed_watchdog) {
    const canopen::NodeAction action = node_.process(clock_us_());
    if (node_.joint_path_sound()) feed_watchdog();
    return action != canopen::NodeAction::kRestart;
  }

 private:
  std::uint64_t (*clock_us_)();
  std::array<std::uint8_t, kMaxImageLength> first_ = {};
  std::array<std::uint8_t, kMaxImageLength> second_ = {};
  Compensator compensator_;
  canopen::IdentityVerifier verifier_;
  storage::SlotStore store_;
  canopen::Node node_;
};

}  // namespace armtrue::ports

#endif  // ARMTRUE_FIRMWARE_PORTS_COMMON_DEVICE_H_
