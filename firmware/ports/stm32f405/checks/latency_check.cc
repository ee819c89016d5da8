// Test image: measures the delay with which SYNC and targets leave the node, and its variation. The
// node runs between two buses in memory whose frames arrive at set times, also while the node is
// busy. Time is counted in instructions; time in which the core would sleep is skipped. Not
// included: the CAN driver and its interrupts, and other traffic on the drives' bus.
//
// Command line: INPUT RESULT. INPUT: a Setup, then a recording (firmware/replay/replay.h). A cycle:
// SYNC, then the target frames back to back; feedback frames from 100 µs after SYNC; a client's SDO
// request within 150 µs of SYNC and a heartbeat of a drive, both at random times. Result: one
// Measured per cycle.
#include <algorithm>
#include <array>
#include <cstdint>
#include <span>

#include "firmware/canopen/protocol/little_endian.h"
#include "firmware/ports/arm/instruction_counter.h"
#include "firmware/ports/arm/semihosting.h"
#include "firmware/ports/common/slot_parameters.h"
#include "firmware/ports/stm32f405/checks/installed_table.h"
#include "firmware/replay/replay.h"

namespace {

using namespace armtrue;
using namespace armtrue::checks;
using canopen::CanFrame;

constexpr std::uint32_t kSyncId = 0x080;
constexpr std::uint32_t kTargetId = 0x221;    // of the first frame; each next one is one higher
constexpr std::uint32_t kFeedbackId = 0x1A1;  // likewise
constexpr std::uint32_t kOffsetId = 0x2A1;    // likewise
constexpr std::uint16_t kFirstFeedbackRpdo = 8;
constexpr std::uint32_t kNever = UINT32_MAX;

enum Failure : std::uint32_t { kBadCommandLine = 1, kBadInput, kNotInstalled, kSdoRefused };

struct Setup {
  std::uint32_t mode;            // 0x2000 sub 1
  std::uint32_t axes_per_frame;  // 1, 2; 6: CAN FD
  std::uint32_t synchronous;     // targets wait for the next SYNC
  std::uint32_t instructions_per_ms;
};

// Instructions from a frame's arrival to its output; kNever: there was none.
struct Measured {
  std::uint32_t sync_taken;    // until SYNC for the drives is given to their port
  std::uint32_t sync_on_wire;  // until SYNC begins on the drives' bus, after earlier frames
  std::uint32_t output_taken;  // likewise, of the last frame of targets (offsets)
  std::uint32_t output_on_wire;
};

// The clock: instructions executed plus those skipped while the core would sleep.
std::uint32_t skipped = 0;
std::uint32_t now() { return ports::InstructionCounter::read() + skipped; }
bool has_come(std::uint32_t time) { return static_cast<std::int32_t>(now() - time) >= 0; }
// Instructions until `time`; 0 if it has come.
std::uint32_t until(std::uint32_t time) {
  const auto left = static_cast<std::int32_t>(time - now());
  return left > 0 ? static_cast<std::uint32_t>(left) : 0;
}

Setup setup;
std::uint32_t cycle_begin = 0;
std::uint64_t cycle_begin_us = 1'000'000;
std::uint32_t us_per_instruction = 0;  // times 65536

std::uint64_t clock_us() {
  return cycle_begin_us + ((now() - cycle_begin) * us_per_instruction >> 16);
}
std::uint32_t instructions_of(std::uint32_t us) { return us * (setup.instructions_per_ms / 1000); }

// Duration of a frame at 1 Mbit/s (FD: data at 5 Mbit/s), in instructions, with a usual number of
// stuff bits.
std::uint32_t bus_time_of(const CanFrame& frame) {
  return instructions_of(frame.is(canopen::kFrameFd) ? 40U + 2U * frame.len
                                                     : 50U + 10U * frame.len);
}

class TimedPort final : public canopen::CanPort {
 public:
  struct Arrival {
    CanFrame frame;
    std::uint32_t time;
  };
  struct Sent {
    std::uint32_t id;
    std::uint32_t taken;
    std::uint32_t on_wire;
  };

  bool queue(const CanFrame& frame, const canopen::Command* command) override {
    const std::uint32_t taken = now();
    const bool is_free = static_cast<std::int32_t>(taken - free_at_) >= 0;
    const std::uint32_t on_wire = is_free ? taken : free_at_;
    free_at_ = on_wire + bus_time_of(frame);
    if (sent_count < sent.size()) sent[sent_count++] = {frame.id, taken, on_wire};
    last = frame;
    if (command != nullptr) note_command_gone();
    return true;
  }
  void discard_commands(canopen::Discarded&) override {}
  bool receive(CanFrame& frame) override {
    if (next_ == count_ || !has_come(arrivals_[next_].time)) return false;
    frame = arrivals_[next_++].frame;
    return true;
  }
  canopen::BusState bus_state() override { return canopen::BusState::kActive; }
  void recover() override {}
  canopen::BusCounters counters() const override { return {}; }
  bool supports_fd() const override { return setup.axes_per_frame == kJoints; }

  void clear() { next_ = count_ = sent_count = 0; }
  // Adds an arrival. Calls may come in any order of `time`.
  void arrive(const CanFrame& frame, std::uint32_t time) {
    std::uint32_t at = count_++;
    for (; at > 0 && static_cast<std::int32_t>(arrivals_[at - 1].time - time) > 0; --at) {
      arrivals_[at] = arrivals_[at - 1];
    }
    arrivals_[at] = {frame, time};
  }
  // Instructions until the next frame; kNever if there is none.
  std::uint32_t until_next() const {
    return next_ == count_ ? kNever : until(arrivals_[next_].time);
  }
  std::uint32_t find_last(std::uint32_t first_id, std::uint32_t ids,
                          std::uint32_t Sent::*time) const {
    for (std::uint32_t i = sent_count; i > 0; --i) {
      if (sent[i - 1].id - first_id < ids) return sent[i - 1].*time;
    }
    return kNever;
  }

  std::array<Sent, 32> sent;
  std::uint32_t sent_count = 0;
  CanFrame last;

 private:
  std::array<Arrival, 24> arrivals_;
  std::uint32_t next_ = 0;
  std::uint32_t count_ = 0;
  std::uint32_t free_at_ = 0;
};

TimedPort upstream;
TimedPort downstream;

std::uint32_t random_state = 1;
std::uint32_t random_below(std::uint32_t bound) {
  random_state = random_state * 1664525U + 1013904223U;
  return static_cast<std::uint32_t>(static_cast<std::uint64_t>(random_state) * bound >> 32);
}

CanFrame frame_of(std::uint32_t id, std::uint8_t len) {
  CanFrame frame;
  frame.id = id;
  frame.len = len;
  return frame;
}

// The k-th frame of a set. `value`: one per axis.
CanFrame axes_frame(std::uint32_t first_id, std::uint32_t k, const std::int32_t* value) {
  const std::uint32_t axes = setup.axes_per_frame;
  CanFrame frame = frame_of(first_id + k, static_cast<std::uint8_t>(4 * axes));
  if (axes == kJoints) frame.flags = canopen::kFrameFd | canopen::kFrameBitRateSwitch;
  for (std::uint32_t i = 0; i < axes; ++i) {
    canopen::store_le(&frame.data[4 * i], value[k * axes + i]);
  }
  return frame;
}

void turn(ports::Device& device) {
  device.turn([] {});
}

CanFrame request_of(std::uint8_t command, std::uint16_t index, std::uint8_t subindex,
                    std::uint32_t value) {
  CanFrame request = frame_of(0x600 + kNodeId, 8);
  request.data[0] = command;
  canopen::store_le(&request.data[1], index);
  request.data[3] = subindex;
  canopen::store_le(&request.data[4], value);
  return request;
}

// SDO download, expedited (CiA 301, 7.2.4.3).
void write_object(ports::Device& device, std::uint16_t index, std::uint8_t subindex,
                  std::uint32_t value, std::uint8_t size) {
  upstream.clear();
  upstream.arrive(
      request_of(static_cast<std::uint8_t>(0x23 | (4 - size) << 2), index, subindex, value), now());
  turn(device);
  if (upstream.last.id != 0x580 + kNodeId || upstream.last.data[0] != 0x60) {
    semihosting::print_unsigned(static_cast<std::uint32_t>(index) << 8 | subindex);
    semihosting::exit(kSdoRefused);
  }
}

void map_axes(ports::Device& device, std::uint16_t communication, std::uint32_t id,
              std::uint16_t object) {
  const auto mapping = static_cast<std::uint16_t>(communication + 0x200);
  const std::uint32_t axes = setup.axes_per_frame;
  for (std::uint16_t k = 0; k < kJoints / axes; ++k) {
    const auto parameter = static_cast<std::uint16_t>(communication + k);
    const auto map = static_cast<std::uint16_t>(mapping + k);
    write_object(device, parameter, 1, 0xC0000000U | (id + k), 4);
    write_object(device, map, 0, 0, 1);
    for (std::uint32_t i = 0; i < axes; ++i) {
      const std::uint32_t index = object + 0x800U * (k * axes + i);
      write_object(device, map, static_cast<std::uint8_t>(i + 1), index << 16 | 32, 4);
    }
    write_object(device, map, 0, axes, 1);
    if (object == 0x607A && setup.synchronous != 0) write_object(device, parameter, 2, 1, 1);
    write_object(device, parameter, 1, 0x40000000U | (id + k), 4);
  }
}

void configure(ports::Device& device) {
  map_axes(device, 0x1400, kTargetId, 0x607A);
  map_axes(device, 0x1400 + kFirstFeedbackRpdo, kFeedbackId, 0x6064);
  if (setup.mode == 2) map_axes(device, 0x1800, kOffsetId, 0x60B0);
  write_object(device, 0x2000, 4, 1'000'000, 4);  // six frames take longer than the default window
  write_object(device, 0x2000, 1, setup.mode, 1);
  CanFrame start = frame_of(0, 2);
  start.data[0] = 1;
  start.data[1] = kNodeId;
  upstream.clear();
  upstream.arrive(start, now());
  turn(device);
}

// Schedules the frames of a cycle that begins now; returns when the last target arrives.
std::uint32_t schedule(const std::int32_t* targets, const std::int32_t* positions,
                       std::uint32_t cycle) {
  const std::uint32_t frames = kJoints / setup.axes_per_frame;
  upstream.clear();
  downstream.clear();
  const std::uint32_t sync = cycle_begin + instructions_of(200);
  upstream.arrive(frame_of(kSyncId, 0), sync);
  std::uint32_t at = sync + instructions_of(20);
  for (std::uint32_t k = 0; k < frames; ++k) {
    const CanFrame frame = axes_frame(kTargetId, k, targets);
    at += bus_time_of(frame);
    upstream.arrive(frame, at);
  }
  const std::uint32_t last_target = at;
  at = sync + instructions_of(100);
  for (std::uint32_t k = 0; k < frames; ++k) {
    const CanFrame frame = axes_frame(kFeedbackId, k, positions);
    at += bus_time_of(frame);
    downstream.arrive(frame, at);
  }
  const auto value = static_cast<std::uint8_t>(1 + cycle / 2 % 16);
  const std::uint16_t object = cycle % 4 < 2 ? 0x2013 : 0x2001;
  upstream.arrive(request_of(0x40, object, value, 0),
                  cycle_begin + instructions_of(50) + random_below(instructions_of(300)));
  CanFrame heartbeat = frame_of(0x701, 1);
  heartbeat.data[0] = 5;
  downstream.arrive(heartbeat, cycle_begin + random_below(instructions_of(1000)));
  return last_target;
}

Measured run_cycle(ports::Device& device, const std::int32_t* targets,
                   const std::int32_t* positions, std::uint32_t cycle) {
  const std::uint32_t last_target = schedule(targets, positions, cycle);
  const std::uint32_t sync = cycle_begin + instructions_of(200);
  const std::uint32_t tick = cycle_begin + instructions_of(700);  // the millisecond interrupt
  const std::uint32_t end = cycle_begin + setup.instructions_per_ms;
  bool has_ticked = false;
  for (;;) {
    std::uint32_t sleep = std::min(upstream.until_next(), downstream.until_next());
    if (!has_ticked) sleep = std::min(sleep, until(tick));
    if (sleep == kNever) break;
    skipped += sleep;
    has_ticked = has_ticked || has_come(tick);
    turn(device);
  }
  skipped += until(end);
  TimedPort& output = setup.mode == 2 ? upstream : downstream;
  const std::uint32_t output_id = setup.mode == 2 ? kOffsetId : kTargetId;
  const std::uint32_t begin = setup.synchronous != 0 ? sync : last_target;
  const auto since = [](std::uint32_t from, std::uint32_t to) {
    return to == kNever ? kNever : to - from;
  };
  using Sent = TimedPort::Sent;
  return {since(sync, downstream.find_last(kSyncId, 1, &Sent::taken)),
          since(sync, downstream.find_last(kSyncId, 1, &Sent::on_wire)),
          since(begin, output.find_last(output_id, kJoints, &Sent::taken)),
          since(begin, output.find_last(output_id, kJoints, &Sent::on_wire))};
}

}  // namespace

int main() {
  std::int32_t input = 0;
  std::int32_t output = 0;
  if (!semihosting::open_files(input, output)) semihosting::exit(kBadCommandLine);

  replay::RecordingHead head;
  if (semihosting::read(input, &setup, sizeof setup) != sizeof setup ||
      semihosting::read(input, &head, sizeof head) != sizeof head || head.magic != replay::kMagic ||
      head.joints != kJoints || head.length_a > image.size() || head.length_b != 0 ||
      semihosting::read(input, image.data(), head.length_a) != head.length_a) {
    semihosting::exit(kBadInput);
  }
  if (!install(std::span(image).first(head.length_a))) semihosting::exit(kNotInstalled);

  const ports::InstructionCounter counter;
  us_per_instruction = 65'536'000U / setup.instructions_per_ms;
  cycle_begin = now();
  static ports::SlotParameters parameters(parameter_flash);
  parameters.start();
  static ports::Device device(kSettings,
                              {upstream, &downstream, table_flash, parameters, &clock_us});
  device.start();
  turn(device);
  configure(device);

  replay::RecordedCycle cycle;
  std::array<std::int32_t, kMaxJoints> positions = {};
  for (std::uint32_t i = 0; i < head.cycles; ++i) {
    if (semihosting::read(input, &cycle, sizeof cycle) != sizeof cycle)
      semihosting::exit(kBadInput);
    const std::uint64_t next_us = cycle_begin_us + 1000;
    if (i == 0) {
      cycle_begin_us = clock_us();
    } else {
      cycle_begin_us = next_us;
    }
    cycle_begin = now();
    const Measured measured =
        run_cycle(device, cycle.target, i == 0 ? cycle.target : positions.data(), i);
    std::copy_n(cycle.target, kMaxJoints, positions.begin());
    semihosting::write(output, &measured, sizeof measured);
  }
  semihosting::close(output);
  semihosting::exit(0);
}
