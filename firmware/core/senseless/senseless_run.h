// Requirements that hold for any accepted table, whatever its content.
#ifndef ARMTRUE_FIRMWARE_CORE_SENSELESS_SENSELESS_RUN_H_
#define ARMTRUE_FIRMWARE_CORE_SENSELESS_SENSELESS_RUN_H_

#include <cstdint>
#include <string>
#include <vector>

#include "firmware/core/compensator.h"
#include "firmware/core/senseless/senseless_image.h"

namespace armtrue::tests {

inline constexpr int kSenselessCycles = 12;

// Inputs at the limits of what a bus can carry; always the same for a table.
std::vector<CycleInput> senseless_inputs(SenselessImage& made);

struct SenselessRun {
  std::string wrong;  // the requirement that was broken, or empty
  bool accepted = false;
  Bytes outputs;  // corrections and flags of every cycle
};

// Loads the table of a seed and runs its cycles. Every 16th table is signed and checked by a device
// with a key.
SenselessRun run_senseless(std::uint64_t seed);

}  // namespace armtrue::tests

#endif  // ARMTRUE_FIRMWARE_CORE_SENSELESS_SENSELESS_RUN_H_
