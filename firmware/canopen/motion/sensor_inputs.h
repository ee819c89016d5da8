// Supervises temperatures (0x2020) and the payload (0x2021), written by PDO or SDO. EMCY 0xFF12 is
// raised if a temperature falls silent, or if an input that the table reads was never written.
//
// The payload does not change by itself: it is written once and never falls silent.
#ifndef ARMTRUE_FIRMWARE_CANOPEN_MOTION_SENSOR_INPUTS_H_
#define ARMTRUE_FIRMWARE_CANOPEN_MOTION_SENSOR_INPUTS_H_

#include <array>
#include <cstddef>
#include <cstdint>

#include "firmware/canopen/protocol/emcy.h"
#include "firmware/canopen/protocol/object_dictionary.h"
#include "firmware/canopen/protocol/pdo.h"
#include "firmware/core/compensator.h"

namespace armtrue::canopen {

class SensorInputs {
 public:
  SensorInputs(ObjectDictionary& dictionary, Emcy& emcy) : dictionary_(dictionary), emcy_(emcy) {}

  // Writes every value of a PDO into the dictionary, also values mapped beside targets.
  // Precondition: frame.len >= pdo.mapping.length.
  void take(const Pdo& pdo, const CanFrame& frame, std::uint64_t now_us);

  // Notes that an object was written; objects other than these inputs are ignored.
  void note(std::uint16_t index, std::uint8_t sub, std::uint64_t now_us);

  // Fills in temperatures, their validity and the payload. A silent temperature is not valid.
  void read(CycleInput& input) const;

  // Call once per turn. `needed`: inputs that the table reads (Compensator::needed_inputs()). An
  // input that was never written counts as silent since it became needed.
  void watch(std::uint32_t needed, std::uint64_t now_us);

 private:
  static constexpr std::size_t kPayload = kMaxSensors;  // index after the temperatures

  ObjectDictionary& dictionary_;
  Emcy& emcy_;
  std::array<std::uint64_t, kMaxSensors + 1> silent_since_us_ = {};
  std::uint32_t given_ = 0;   // bit k: input k has been written within the time-out
  std::uint32_t broken_ = 0;  // bit k: the last value of input k indicates a broken sensor
};

}  // namespace armtrue::canopen

#endif  // ARMTRUE_FIRMWARE_CANOPEN_MOTION_SENSOR_INPUTS_H_
