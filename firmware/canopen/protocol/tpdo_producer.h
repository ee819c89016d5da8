// Sends the TPDOs: on SYNC, on change, on their event timer, or with a new correction.
//
// A TPDO that maps a position offset (0x60B0) is a *joint output*: it leaves once for each complete
// set of targets and for each step of a fade to zero. It never leaves otherwise, so that a drive's
// own time-out detects when corrections stop.
#ifndef ARMTRUE_FIRMWARE_CANOPEN_PROTOCOL_TPDO_PRODUCER_H_
#define ARMTRUE_FIRMWARE_CANOPEN_PROTOCOL_TPDO_PRODUCER_H_

#include <array>
#include <cstdint>

#include "firmware/canopen/protocol/can_port.h"
#include "firmware/canopen/protocol/dictionary_access.h"
#include "firmware/canopen/protocol/pdo.h"

namespace armtrue::canopen {

class TpdoProducer {
 public:
  TpdoProducer(ObjectDictionary& dictionary, const PdoTable& pdos, ObjectHooks& hooks)
      : dictionary_(dictionary), pdos_(pdos), hooks_(hooks) {}

  // Restarts the timers; no TPDO counts as sent.
  void restart(std::uint64_t now_us);

  // Sends the joint outputs of a new correction, which control cycle `cycle` computed. Synchronous
  // ones wait for SYNC unless `at_once`, for a node that leaves operational before the next SYNC.
  // Returns how many joint outputs the port refused.
  std::uint32_t on_fresh_outputs(CanPort& port, std::uint32_t cycle, std::uint64_t now_us,
                                 bool at_once);

  // Sends what is due on SYNC. `counter`: of the SYNC frame, 0 if it carries none. `cycle`: the
  // last one whose correction is out. Returns how many joint outputs the port refused.
  std::uint32_t on_sync(CanPort& port, std::uint8_t counter, std::uint32_t cycle,
                        std::uint64_t now_us);

  // Bit k: the newest offset of axis k has not left, because it waits for SYNC or was refused.
  std::uint32_t unsent() const;

  // Sends asynchronous TPDOs, joint outputs excepted, on change or on their event timer.
  void process(CanPort& port, std::uint64_t now_us);

 private:
  struct Schedule {
    CanFrame last;
    bool has_last = false;
    bool fresh = false;    // joint output: the newest one has not been sent
    bool started = false;  // SYNC start value has been seen
    std::uint8_t syncs = 0;
    std::uint64_t inhibited_until_us = 0;
    std::uint64_t event_due_us = 0;
  };

  void sample(const Pdo& pdo, CanFrame& frame);
  bool transmit(CanPort& port, std::size_t number, const CanFrame& frame, std::uint64_t now_us,
                std::uint32_t cycle = 0);
  std::uint32_t offset_axes(std::size_t number) const {
    return mapped_axes(pdos_.tpdos().subspan(number, 1), kPositionOffset);
  }
  bool is_due_on_sync(std::size_t number, std::uint8_t counter);

  ObjectDictionary& dictionary_;
  const PdoTable& pdos_;
  ObjectHooks& hooks_;
  std::array<Schedule, kTpdos> schedules_ = {};
};

}  // namespace armtrue::canopen

#endif  // ARMTRUE_FIRMWARE_CANOPEN_PROTOCOL_TPDO_PRODUCER_H_
