// What has to hold for any table that is let in, whatever stands in it.
#ifndef ARMTRUE_FIRMWARE_CORE_SENSELESS_SENSELESS_RUN_H_
#define ARMTRUE_FIRMWARE_CORE_SENSELESS_SENSELESS_RUN_H_

#include <cstdint>
#include <string>
#include <vector>

#include "firmware/core/compensator.h"
#include "firmware/core/senseless/senseless_image.h"

namespace armtrue::tests {

inline constexpr int kSenselessCycles = 12;

// Inputs at the ends of what a bus can carry; the same for the same table.
std::vector<CycleInput> senseless_inputs(SenselessImage& made);

struct SenselessRun {
  std::string wrong;  // empty if nothing was
  bool accepted = false;
  Bytes outputs;  // corrections and flags of every cycle
};

// Loads the table of a seed as a device with a key would (every 16th is signed and checked with it)
// and runs its cycles.
SenselessRun run_senseless(std::uint64_t seed);

}  // namespace armtrue::tests

#endif  // ARMTRUE_FIRMWARE_CORE_SENSELESS_SENSELESS_RUN_H_
