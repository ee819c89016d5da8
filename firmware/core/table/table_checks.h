// The part of validate() that reads sections and records.
#ifndef ARMTRUE_FIRMWARE_CORE_TABLE_TABLE_CHECKS_H_
#define ARMTRUE_FIRMWARE_CORE_TABLE_TABLE_CHECKS_H_

#include <cstdint>
#include <span>

#include "firmware/core/table/table.h"

namespace armtrue {

// Checks the header fields behind the envelope, the directory, and every record of every section.
// `body`: the image without signature and checksum, at least a header long. What passes can be
// evaluated without any further check: no reference leaves its section, no shift its range.
Validation check_contents(std::span<const std::uint8_t> body);

}  // namespace armtrue

#endif  // ARMTRUE_FIRMWARE_CORE_TABLE_TABLE_CHECKS_H_
