// RPDOs with targets that are valid no more.
//
// If a set loses one of its RPDOs (NMT reset communication, SDO) while the drives hold a
// correction, its frames would pass inline without it: a step. They are withheld until targets of
// all joints are mapped again. Where their stop commands are is still known.
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
  // Notes all valid RPDOs with targets.
  void note(const PdoTable& pdos) {
    count_ = 0;
    for (const Pdo& pdo : pdos.rpdos()) {
      const bool is_target = pdo.valid && pdo.mapping.has_axis_object(kTargetPosition);
      if (is_target && count_ < rpdos_.size()) rpdos_[count_++] = pdo;
    }
  }
  void clear() { count_ = 0; }

  // The RPDO that the frame belonged to, nullptr if there was none.
  const Pdo* find(const CanFrame& frame) const {
    if (frame.is(kFrameExtended) || frame.is(kFrameRemote)) return nullptr;
    const std::span<const Pdo> rpdos = std::span(rpdos_).first(count_);
    const auto found = std::ranges::find(rpdos, frame.id, &Pdo::id);
    return found == rpdos.end() ? nullptr : &*found;
  }

 private:
  std::array<Pdo, kAxes> rpdos_ = {};  // each RPDO of a set has an axis of its own
  std::size_t count_ = 0;
};

}  // namespace armtrue::canopen

#endif  // ARMTRUE_FIRMWARE_CANOPEN_NODE_WITHHELD_TARGETS_H_
