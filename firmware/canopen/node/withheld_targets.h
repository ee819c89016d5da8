// Identifiers of target frames whose RPDOs are valid no more.
//
// If a set loses one of its RPDOs (NMT reset communication, SDO) while the drives hold a
// correction, its frames would pass inline without it: a step. They are withheld until targets of
// all joints are mapped again.
#ifndef ARMTRUE_FIRMWARE_CANOPEN_NODE_WITHHELD_TARGETS_H_
#define ARMTRUE_FIRMWARE_CANOPEN_NODE_WITHHELD_TARGETS_H_

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include "firmware/canopen/protocol/can_port.h"
#include "firmware/canopen/protocol/pdo.h"

namespace armtrue::canopen {

class WithheldTargets {
 public:
  // Notes the identifiers of all valid RPDOs with targets.
  void note(const PdoTable& pdos) {
    count_ = 0;
    for (const Pdo& pdo : pdos.rpdos()) {
      const bool is_target = pdo.valid && pdo.mapping.has_axis_object(kTargetPosition);
      if (is_target && count_ < ids_.size()) ids_[count_++] = pdo.id;
    }
  }
  void clear() { count_ = 0; }

  bool has(const CanFrame& frame) const {
    const std::span<const std::uint32_t> ids = std::span(ids_).first(count_);
    return !frame.is(kFrameExtended) && !frame.is(kFrameRemote) &&
           std::ranges::find(ids, frame.id) != ids.end();
  }

 private:
  std::array<std::uint32_t, kAxes> ids_ = {};  // each RPDO of a set has an axis of its own
  std::size_t count_ = 0;
};

}  // namespace armtrue::canopen

#endif  // ARMTRUE_FIRMWARE_CANOPEN_NODE_WITHHELD_TARGETS_H_
