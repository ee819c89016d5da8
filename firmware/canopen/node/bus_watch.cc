#include "firmware/canopen/node/bus_watch.h"

namespace armtrue::canopen {

// A command accepted after the mark is marked itself before the first half of the limit is over,
// and is gone within the second.
void BusWatch::watch_commands(std::uint64_t now_us, Discarded& discarded) {
  const CommandCounts commands = port_.commands();
  if (static_cast<std::int32_t>(commands.gone - marked_) >= 0) {
    marked_ = commands.accepted;
    marked_us_ = now_us;
  } else if (now_us - marked_us_ >= kCommandLifeUs / 2) {
    port_.discard_commands(discarded);
  }
}

void BusWatch::process(std::uint64_t now_us, Discarded& discarded) {
  watch_commands(now_us, discarded);
  const BusState state = port_.bus_state();
  const BusCounters counters = port_.counters();
  if (state == BusState::kBusOff) {
    emcy_.raise(bus_off_, counters.bus_off_entries);
    if (!off_) {
      off_ = true;
      port_.discard_commands(discarded);
      paused_since_us_ = now_us;
    } else if (now_us - paused_since_us_ >= kRecoveryPauseUs) {
      // Again and again: the controller may have gone off once more between two turns.
      paused_since_us_ = now_us;
      port_.recover();
    }
  } else if (off_) {
    off_ = false;
    emcy_.clear(bus_off_);
  } else if (counters.bus_off_entries != off_entries_) {
    // Bus-off and recovered between two calls.
    emcy_.raise(bus_off_, counters.bus_off_entries);
    emcy_.clear(bus_off_);
  }
  off_entries_ = counters.bus_off_entries;
  // Both buses raise these conditions; the source tells them apart.
  const std::size_t source = bus_off_ == Condition::kBusOffUpstream ? 0 : 1;
  if (state == BusState::kPassive) {
    emcy_.raise(Condition::kBusPassive, 0, source);
  } else if (state != BusState::kBusOff) {
    emcy_.clear(Condition::kBusPassive, source);
  }
  if (counters.receive_overruns != overruns_) {
    overruns_ = counters.receive_overruns;
    last_overrun_us_ = now_us;
    emcy_.raise(Condition::kReceiveOverrun, overruns_, source);
  } else if (now_us - last_overrun_us_ >= kOverrunMemoryUs) {
    emcy_.clear(Condition::kReceiveOverrun, source);
  }
}

}  // namespace armtrue::canopen
