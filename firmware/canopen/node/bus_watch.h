// Watches one controller: recovery from bus-off, error states, lost frames, commands that do not
// leave.
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

  // Adds the commands that it had to discard to `discarded`.
  void process(std::uint64_t now_us, Discarded& discarded);

  // A command that the controller could not send within this time (and one turn of the loop) is
  // discarded. Without acknowledgement, a controller becomes error passive and keeps its frames
  // until a drive answers again, which would then act on old targets. On a busy bus this is long
  // enough for a full queue: 35 frames take 5 ms at 1 Mbit/s. Answers, emergencies and NMT stay in
  // the queue, however old.
  static constexpr std::uint64_t kCommandLifeUs = 20'000;

  // Pause before each recovery, so that a controller which goes bus-off again at once does not
  // disturb the bus all the time.
  static constexpr std::uint64_t kRecoveryPauseUs = 100'000;
  // An overrun is over when no further frame was lost for this long.
  static constexpr std::uint64_t kOverrunMemoryUs = 1'000'000;

 private:
  void watch_commands(std::uint64_t now_us, Discarded& discarded);

  CanPort& port_;
  Emcy& emcy_;
  Condition bus_off_;
  std::uint32_t off_entries_;
  bool off_ = false;
  std::uint64_t paused_since_us_ = 0;  // bus-off noticed, or the last recovery begun
  std::uint32_t overruns_;
  // Commands that had been accepted at marked_us_. When they are gone, the next ones are marked.
  std::uint32_t marked_ = 0;
  std::uint64_t marked_us_ = 0;
  std::uint64_t last_overrun_us_ = 0;
};

}  // namespace armtrue::canopen

#endif  // ARMTRUE_FIRMWARE_CANOPEN_NODE_BUS_WATCH_H_
