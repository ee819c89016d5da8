// Watches one controller: recovery from bus-off, error states, lost frames.
#ifndef ARMTRUE_FIRMWARE_CANOPEN_NODE_BUS_WATCH_H_
#define ARMTRUE_FIRMWARE_CANOPEN_NODE_BUS_WATCH_H_

#include <cstdint>

#include "firmware/canopen/protocol/can_port.h"
#include "firmware/canopen/protocol/emcy.h"

namespace armtrue::canopen {

class BusWatch {
 public:
  // `bus_off` is the condition that this bus raises.
  BusWatch(CanPort& port, Emcy& emcy, Condition bus_off)
      : port_(port),
        emcy_(emcy),
        bus_off_(bus_off),
        off_entries_(port.counters().bus_off_entries),
        overruns_(port.counters().receive_overruns) {}

  void process(std::uint64_t now_us);

  // Pause before each recovery, so that a controller which goes bus-off again at once does not
  // disturb the bus all the time.
  static constexpr std::uint64_t kRecoveryPauseUs = 100'000;
  // An overrun is over when no further frame was lost for this long.
  static constexpr std::uint64_t kOverrunMemoryUs = 1'000'000;

 private:
  CanPort& port_;
  Emcy& emcy_;
  Condition bus_off_;
  std::uint32_t off_entries_;
  bool off_ = false;
  std::uint64_t paused_since_us_ = 0;  // bus-off noticed, or the last recovery begun
  std::uint32_t overruns_;
  std::uint64_t last_overrun_us_ = 0;
};

}  // namespace armtrue::canopen

#endif  // ARMTRUE_FIRMWARE_CANOPEN_NODE_BUS_WATCH_H_
