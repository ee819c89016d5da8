// Test image: counts the instructions of a control cycle including the node's CAN path. The node
// runs inline between two buses in memory: no CAN driver and no interrupts. It is given the cycles
// of a recording (firmware/replay/replay.h; requests, temperatures and payload are not used), whose
// first table is installed in the slots and also staged. Six axes: SYNC, three target
// frames, three feedback frames. In the first half of the cycles a client reads one value of the
// status records in every second cycle; in the second half a block upload of the table is running.
// Command line: RECORDING RESULT. Result, per cycle: instructions (from SYNC to the last frame
// forwarded), the object read (index and sub-index, 0 for none), one corrected target per joint.
#include <algorithm>
#include <array>
#include <cstdint>
#include <iterator>
#include <span>

#include "firmware/canopen/protocol/little_endian.h"
#include "firmware/ports/arm/instruction_counter.h"
#include "firmware/ports/arm/semihosting.h"
#include "firmware/ports/common/classic_frame.h"
#include "firmware/ports/common/slot_parameters.h"
#include "firmware/ports/stm32f405/checks/installed_table.h"
#include "firmware/replay/replay.h"

namespace {

using namespace armtrue;
using namespace armtrue::checks;
using canopen::CanFrame;

constexpr std::uint32_t kFrames = kJoints / 2;
constexpr std::uint32_t kTargetId = 0x220;    // of the first two axes; the next are 0x100 apart
constexpr std::uint32_t kFeedbackId = 0x1A0;  // likewise
constexpr std::uint8_t kFirstFeedbackRpdo = 8;

enum Failure : std::uint32_t {
  kBadCommandLine = 1,
  kBadRecording,
  kNotInstalled,
  kSdoRefused,
  kNotReleased,
  kNotAnswered
};

// Records that a client reads in motion (`armtrue device info` and the monitor).
struct Record {
  std::uint16_t index;
  std::uint8_t last_subindex;
};
constexpr Record kRecords[] = {{0x2013, 17}, {0x2001, 16}, {0x2002, 8}, {0x2003, 8}, {0x1018, 4}};

// Both directions of one bus, without a CAN controller.
class MemoryPort final : public canopen::CanPort {
 public:
  bool queue(const CanFrame& frame, const canopen::Command* command) override {
    if (command != nullptr) note_command_gone();
    return out.push(ports::ClassicFrame::from(frame, command));
  }
  void discard_commands(canopen::Discarded&) override {}
  bool receive(CanFrame& frame) override {
    ports::ClassicFrame classic;
    if (!in.pop(classic)) return false;
    classic.copy_to(frame);
    return true;
  }
  canopen::BusState bus_state() override { return canopen::BusState::kActive; }
  void recover() override {}
  canopen::BusCounters counters() const override { return {}; }

  ports::Queue<ports::ClassicFrame, 32> in;
  ports::Queue<ports::ClassicFrame, 32> out;
};

std::uint64_t now_us = 0;
std::uint64_t clock_us() { return now_us; }

MemoryPort upstream;
MemoryPort downstream;

ports::ClassicFrame frame_of(std::uint32_t id, std::uint8_t len) {
  return {id, canopen::kFrameNone, len, {}, {}};
}

ports::ClassicFrame pair_of(std::uint32_t id, std::int32_t first, std::int32_t second) {
  ports::ClassicFrame frame = frame_of(id, 8);
  canopen::store_le(frame.data.data(), first);
  canopen::store_le(frame.data.data() + 4, second);
  return frame;
}

void turn(ports::Device& device) {
  device.turn([] {});
}

ports::ClassicFrame request_of(std::uint8_t command, std::uint16_t index, std::uint8_t subindex,
                               std::uint32_t value) {
  ports::ClassicFrame request = frame_of(0x600 + kNodeId, 8);
  request.data[0] = command;
  canopen::store_le(&request.data[1], index);
  request.data[3] = subindex;
  canopen::store_le(&request.data[4], value);
  return request;
}

// Takes the frames sent upstream; returns the number of SDO answers, and the newest in `last`.
std::uint32_t take_answers(ports::ClassicFrame& last) {
  std::uint32_t count = 0;
  ports::ClassicFrame answer;
  while (upstream.out.pop(answer)) {
    if (answer.id != 0x580 + kNodeId) continue;
    last = answer;
    ++count;
  }
  return count;
}

void ask(ports::Device& device, const ports::ClassicFrame& request, std::uint8_t specifier) {
  upstream.in.push(request);
  turn(device);
  ports::ClassicFrame answer;
  if (take_answers(answer) == 0 || answer.data[0] >> 5 != specifier) {
    semihosting::exit(kSdoRefused);
  }
}

// Expedited SDO download (CiA 301, 7.2.4.3).
void write_object(ports::Device& device, std::uint16_t index, std::uint8_t subindex,
                  std::uint32_t value, std::uint8_t size) {
  const auto command = static_cast<std::uint8_t>(0x23 | (4 - size) << 2);
  ask(device, request_of(command, index, subindex, value), 3);
}

// Segmented SDO download of `table`.
void stage(ports::Device& device, std::span<const std::uint8_t> table) {
  ask(device,
      request_of(0x21, canopen::kStagingObject, 0, static_cast<std::uint32_t>(table.size())), 3);
  std::uint8_t toggle = 0;
  for (std::size_t at = 0; at < table.size(); at += 7, toggle ^= 0x10U) {
    const std::span<const std::uint8_t> piece =
        table.subspan(at, std::min<std::size_t>(7, table.size() - at));
    const bool is_last = at + piece.size() == table.size();
    ports::ClassicFrame segment = frame_of(0x600 + kNodeId, 8);
    segment.data[0] = static_cast<std::uint8_t>(toggle | (7 - piece.size()) << 1 | is_last);
    std::copy(piece.begin(), piece.end(), segment.data.begin() + 1);
    ask(device, segment, 1);
  }
}

// A client. In the first half of all cycles it reads one value in every second cycle; in the second
// half it continues a block upload of the active table.
class Client {
 public:
  // Queues this cycle's request upstream, if any. Returns the object that the client reads (index
  // and sub-index); 0: none.
  std::uint32_t ask(std::uint32_t cycle, std::uint32_t cycles) {
    asked_ = 0;
    expects_ = false;
    if (cycle % 2 == 0 && !is_dumping_) return 0;
    is_dumping_ = 2 * cycle >= cycles;
    asked_ = is_dumping_ ? std::uint32_t{canopen::kActiveObject} << 8 : next_value();
    const auto index = static_cast<std::uint16_t>(asked_ >> 8);
    if (!is_dumping_) {
      send(request_of(0x40, index, static_cast<std::uint8_t>(asked_), 0));
    } else if (step_ == Step::kInitiate) {
      send(request_of(0xA4, index, 0, kSegments));
    } else if (step_ == Step::kStart) {
      send(request_of(0xA3, 0, 0, 0));
    } else if (segments_ == kSegments) {
      ports::ClassicFrame acknowledgement = request_of(0xA2, 0, 0, 0);
      acknowledgement.data[1] = acknowledgement.data[2] = kSegments;
      segments_ = 0;
      send(acknowledgement);
    }
    return asked_;
  }

  void take_answer() {
    ports::ClassicFrame answer;
    const std::uint32_t count = take_answers(answer);
    if (!is_dumping_) {
      if (count != (expects_ ? 1U : 0U) || (expects_ && answer.data[0] >> 5 != 2)) fail();
    } else if (step_ == Step::kInitiate) {
      if (count != 1 || answer.data[0] != 0xC6) fail();
      step_ = Step::kStart;
    } else {
      if (count > 1 || (count == 1 && answer.data[0] != segments_ + 1U)) fail();
      segments_ = static_cast<std::uint8_t>(segments_ + count);
      step_ = Step::kSegments;
    }
  }

 private:
  enum class Step : std::uint8_t { kInitiate, kStart, kSegments };
  static constexpr std::uint8_t kSegments = 127;

  [[noreturn]] static void fail() { semihosting::exit(kNotAnswered); }

  void send(const ports::ClassicFrame& request) {
    upstream.in.push(request);
    expects_ = true;
  }

  std::uint32_t next_value() {
    if (subindex_ == kRecords[record_].last_subindex) {
      subindex_ = 0;
      record_ = (record_ + 1) % std::size(kRecords);
    }
    ++subindex_;
    return static_cast<std::uint32_t>(kRecords[record_].index) << 8 | subindex_;
  }

  std::uint32_t asked_ = 0;
  bool expects_ = false;
  bool is_dumping_ = false;
  Step step_ = Step::kInitiate;
  std::uint8_t segments_ = 0;
  std::size_t record_ = 0;
  std::uint8_t subindex_ = 0;
};

void configure(ports::Device& device) {
  for (std::uint16_t i = 0; i < kFrames; ++i) {
    write_object(device, static_cast<std::uint16_t>(0x1400 + i), 1, kTargetId + 0x100U * i, 4);
    write_object(device, static_cast<std::uint16_t>(0x1400 + kFirstFeedbackRpdo + i), 1,
                 kFeedbackId + 0x100U * i, 4);
  }
  write_object(device, 0x2000, 1, static_cast<std::uint32_t>(canopen::Mode::kInline), 1);
  ports::ClassicFrame start = frame_of(0, 2);
  start.data = {1, kNodeId};
  upstream.in.push(start);
  turn(device);
  upstream.out.clear();
  downstream.out.clear();
}

void push_targets(const replay::RecordedCycle& cycle) {
  upstream.in.push(frame_of(0x80, 0));
  for (std::uint32_t i = 0; i < kFrames; ++i) {
    upstream.in.push(pair_of(kTargetId + 0x100 * i, cycle.target[2 * i], cycle.target[2 * i + 1]));
  }
}

// Sends one complete set: the node forwards targets only after an interval with a complete set.
void begin_stream(ports::Device& device, const replay::RecordedCycle& first) {
  push_targets(first);
  turn(device);
  downstream.out.clear();
}

// Runs one control cycle and returns its instructions. `corrected`: targets sent to the drives.
std::uint32_t run_cycle(ports::Device& device, const ports::InstructionCounter& counter,
                        const replay::RecordedCycle& cycle,
                        std::array<std::int32_t, kJoints>& corrected) {
  now_us += 1000;
  const std::uint32_t before = counter.read();
  push_targets(cycle);
  turn(device);
  std::uint32_t released = 0;
  ports::ClassicFrame frame;
  while (downstream.out.pop(frame)) {
    const std::uint32_t i = (frame.id - kTargetId) / 0x100;
    if (frame.id < kTargetId || i >= kFrames) continue;
    corrected[2 * i] = canopen::load_le<std::int32_t>(&frame.data[0]);
    corrected[2 * i + 1] = canopen::load_le<std::int32_t>(&frame.data[4]);
    ++released;
    downstream.in.push(pair_of(kFeedbackId + 0x100 * i, corrected[2 * i], corrected[2 * i + 1]));
  }
  if (released != kFrames) semihosting::exit(kNotReleased);
  turn(device);
  const std::uint32_t after = counter.read();
  return counter.between(before, after);
}

}  // namespace

int main() {
  std::int32_t input = 0;
  std::int32_t output = 0;
  if (!semihosting::open_files(input, output)) semihosting::exit(kBadCommandLine);

  replay::RecordingHead head;
  if (semihosting::read(input, &head, sizeof head) != sizeof head || head.magic != replay::kMagic ||
      head.joints != kJoints || head.length_a > image.size() || head.length_b != 0 ||
      semihosting::read(input, image.data(), head.length_a) != head.length_a) {
    semihosting::exit(kBadRecording);
  }
  if (!install(std::span(image).first(head.length_a))) semihosting::exit(kNotInstalled);

  static ports::SlotParameters parameters(parameter_flash);
  parameters.start();
  static ports::Device device(kSettings,
                              {upstream, &downstream, table_flash, parameters, &clock_us});
  device.start();
  turn(device);
  stage(device, std::span(image).first(head.length_a));
  configure(device);

  const ports::InstructionCounter counter;
  struct {
    std::uint32_t instructions;
    std::uint32_t read;
    std::array<std::int32_t, kJoints> corrected;
  } result;
  replay::RecordedCycle cycle;
  Client client;
  for (std::uint32_t i = 0; i < head.cycles; ++i) {
    if (semihosting::read(input, &cycle, sizeof cycle) != sizeof cycle)
      semihosting::exit(kBadRecording);
    if (i == 0) begin_stream(device, cycle);
    result.read = client.ask(i, head.cycles);
    result.instructions = run_cycle(device, counter, cycle, result.corrected);
    client.take_answer();
    semihosting::write(output, &result, sizeof result);
  }
  semihosting::close(output);
  semihosting::exit(0);
}
