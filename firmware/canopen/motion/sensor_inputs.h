// Temperatures (0x2020) and the payload (0x2021): when they were given, by PDO or SDO, and EMCY
// 0xFF12 where one that was given goes silent, or one that the table reads was never given.
//
// A payload does not change by itself: it is given once.
#ifndef ARMTRUE_FIRMWARE_CANOPEN_MOTION_SENSOR_INPUTS_H_
#define ARMTRUE_FIRMWARE_CANOPEN_MOTION_SENSOR_INPUTS_H_

#include <array>
#include <cstddef>
#include <cstdint>

#include "firmware/canopen/protocol/emcy.h"
#include "firmware/canopen/protocol/object_dictionary.h"
#include "firmware/core/compensator.h"

namespace armtrue::canopen {

class SensorInputs {
 public:
  SensorInputs(ObjectDictionary& dictionary, Emcy& emcy) : dictionary_(dictionary), emcy_(emcy) {}

  // An object was written; those of other things are ignored.
  void note(std::uint16_t index, std::uint8_t sub, std::uint64_t now_us);

  // Fills in what the correction is computed with. A silent temperature is not valid.
  void read(CycleInput& input) const;

  // Call once a turn. `needed`: what a correction reads now (Compensator::needed_inputs()). What
  // was never given counts as silent since it became needed.
  void watch(std::uint32_t needed, std::uint64_t now_us);

 private:
  static constexpr std::size_t kPayload = kMaxSensors;  // behind the temperatures

  ObjectDictionary& dictionary_;
  Emcy& emcy_;
  std::array<std::uint64_t, kMaxSensors + 1> silent_since_us_ = {};
  std::uint32_t given_ = 0;   // bit k: input k has been given within the time-out
  std::uint32_t broken_ = 0;  // bit k: what was given last stands for a broken sensor
};

}  // namespace armtrue::canopen

#endif  // ARMTRUE_FIRMWARE_CANOPEN_MOTION_SENSOR_INPUTS_H_
