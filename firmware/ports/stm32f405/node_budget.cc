// Test image: the instructions of a control cycle with the CAN path included. The node runs inline
// between two buses in memory; what it is given are the cycles of a recording
// (firmware/replay/replay.h; requests, temperatures and payload of it are not used), its first
// table installed in the slots. Six axes: SYNC, three target frames, three feedback frames. Command
// line: RECORDING RESULT. Result, per cycle: instructions (from SYNC to the last frame passed on),
// joint count corrected targets.
#include <array>
#include <cstdint>
#include <cstring>
#include <span>

#include "firmware/canopen/little_endian.h"
#include "firmware/ports/arm/instruction_counter.h"
#include "firmware/ports/arm/semihosting.h"
#include "firmware/ports/common/device.h"
#include "firmware/ports/common/frame_queue.h"
#include "firmware/ports/common/slot_parameters.h"
#include "firmware/replay/replay.h"
#include "firmware/storage/ram_flash.h"

namespace {

using namespace armtrue;
using canopen::CanFrame;

constexpr std::uint32_t kJoints = 6;
constexpr std::uint32_t kFrames = kJoints / 2;
constexpr std::uint8_t kNodeId = 32;
constexpr std::uint32_t kTargetId = 0x220;    // of the first two axes; the next are 0x100 apart
constexpr std::uint32_t kFeedbackId = 0x1A0;  // likewise
constexpr std::uint8_t kFirstFeedbackRpdo = 8;

enum Failure : std::uint32_t {
  kBadCommandLine = 1,
  kBadRecording,
  kNotInstalled,
  kSdoRefused,
  kNotReleased
};

// Both directions of one bus, without a controller between.
class MemoryPort final : public canopen::CanPort {
 public:
  bool send(const CanFrame& frame) override { return out.push(ports::ClassicFrame::from(frame)); }
  bool receive(CanFrame& frame) override {
    ports::ClassicFrame classic;
    if (!in.pop(classic)) return false;
    classic.copy_to(frame);
    return true;
  }
  canopen::BusState bus_state() override { return canopen::BusState::kActive; }
  void recover() override {}
  canopen::BusCounters counters() const override { return {}; }
  bool supports_fd() const override { return false; }

  ports::FrameQueue<32> in;
  ports::FrameQueue<32> out;
};

std::uint64_t now_us = 0;
std::uint64_t clock_us() { return now_us; }

struct AcceptAll final : storage::TableVerifier {
  storage::TableVerdict verify(std::span<const std::uint8_t>) const override {
    return storage::TableVerdict::kAccepted;
  }
};

constexpr ports::DeviceSettings kSettings{
    .identity = {.robot_serial = {}, .joint_count = kJoints, .has_key = false, .public_key = {}},
    .node_id = kNodeId,
    .serial_number = 1,
    .joint_count = kJoints,
    .cycle_us = 1000};

std::array<std::uint8_t, 2 * (kMaxImageLength + storage::kHeaderBytes)> table_memory;
std::array<std::uint8_t, 8 * 1024> parameter_memory;
storage::RamFlash table_flash(table_memory);
storage::RamFlash parameter_flash(parameter_memory);
MemoryPort upstream;
MemoryPort downstream;
alignas(4) std::array<std::uint8_t, kMaxImageLength> image;

void install(std::span<const std::uint8_t> table) {
  const AcceptAll verifier;
  storage::SlotStore store(table_flash, verifier);  // memory of zeros: nothing to start from
  std::span<const std::uint8_t> active;
  const bool done = store.commit(table) == storage::StoreResult::kDone &&
                    store.activate(image, active) == storage::StoreResult::kDone &&
                    store.confirm() == storage::StoreResult::kDone;
  if (!done) semihosting::exit(kNotInstalled);
}

ports::ClassicFrame frame_of(std::uint32_t id, std::uint8_t len) {
  return {id, canopen::kFrameNone, len, {}};
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

// Expedited SDO download (CiA 301, 7.2.4.3).
void write_object(ports::Device& device, std::uint16_t index, std::uint8_t subindex,
                  std::uint32_t value, std::uint8_t size) {
  ports::ClassicFrame request = frame_of(0x600 + kNodeId, 8);
  request.data[0] = static_cast<std::uint8_t>(0x23 | (4 - size) << 2);
  canopen::store_le(&request.data[1], index);
  request.data[3] = subindex;
  canopen::store_le(&request.data[4], value);
  upstream.in.push(request);
  turn(device);
  ports::ClassicFrame answer;
  while (upstream.out.pop(answer)) {
    if (answer.id == 0x580 + kNodeId && answer.data[0] == 0x60) return;
  }
  semihosting::exit(kSdoRefused);
}

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

// A stream begins with its second set: the node waits for a whole one before.
void begin_stream(ports::Device& device, const replay::RecordedCycle& first) {
  push_targets(first);
  turn(device);
  downstream.out.clear();
}

// One control cycle; `corrected` is what the drives were told.
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
  upstream.out.clear();
  return counter.between(before, after);
}

}  // namespace

int main() {
  char command_line[256];
  char* space = nullptr;
  if (semihosting::command_line(command_line, sizeof command_line))
    space = std::strchr(command_line, ' ');
  if (space == nullptr) semihosting::exit(kBadCommandLine);
  *space = '\0';
  const std::int32_t input = semihosting::open(command_line, semihosting::OpenMode::kReadBinary);
  const std::int32_t output = semihosting::open(space + 1, semihosting::OpenMode::kWriteBinary);

  replay::RecordingHead head;
  if (semihosting::read(input, &head, sizeof head) != sizeof head || head.magic != replay::kMagic ||
      head.joints != kJoints || head.length_a > image.size() || head.length_b != 0 ||
      semihosting::read(input, image.data(), head.length_a) != head.length_a) {
    semihosting::exit(kBadRecording);
  }
  install(std::span(image).first(head.length_a));

  static ports::SlotParameters parameters(parameter_flash);
  parameters.start();
  static ports::Device device(kSettings,
                              {upstream, &downstream, table_flash, parameters, &clock_us});
  device.start();
  turn(device);
  configure(device);

  const ports::InstructionCounter counter;
  struct {
    std::uint32_t instructions;
    std::array<std::int32_t, kJoints> corrected;
  } result;
  replay::RecordedCycle cycle;
  for (std::uint32_t i = 0; i < head.cycles; ++i) {
    if (semihosting::read(input, &cycle, sizeof cycle) != sizeof cycle)
      semihosting::exit(kBadRecording);
    if (i == 0) begin_stream(device, cycle);
    result.instructions = run_cycle(device, counter, cycle, result.corrected);
    semihosting::write(output, &result, sizeof result);
  }
  semihosting::close(output);
  semihosting::exit(0);
}
