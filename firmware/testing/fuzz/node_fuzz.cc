// The whole node under any sequence of frames, times, refusals and restarts (libFuzzer).
//
// The last byte selects the node's kind and starting state (Setup below). The bytes before it are a
// list of events: one byte for the kind of event, then what it needs.
//   0..95     SDO request of eight bytes; nine of ten address an object that exists
//   96..127   target frame (which pair: low bits), eight bytes
//   128..159  SYNC, NMT, heartbeat or actual positions
//   160..191  any frame on the controllers' side: identifier, flags, length, payload
//   192..207  any frame on the drives' side
//   208..239  time passes: up to 2^16 · 100 µs
//   240..247  the queue takes this many more frames (240..243 upstream in offset mode)
//   248..251  bus-off, on either side
//   252..255  power cycle
#include <algorithm>
#include <array>
#include <cstdint>
#include <cstdlib>
#include <span>

#include "firmware/testing/node_bench.h"
#include "firmware/testing/test_table.h"

namespace {

using namespace armtrue::canopen;

// Every start reads all of the flash: a small one leaves more time for frames.
constexpr std::size_t kSlotSize = 2048;

struct Setup {
  explicit Setup(std::uint8_t choice)
      : mode((choice & 1U) != 0 ? Mode::kOffset : Mode::kInline),
        two_buses(mode == Mode::kInline || (choice & 2U) == 0),
        fd((choice & 4U) == 0),
        saved((choice & 8U) == 0),
        begun((choice & 16U) == 0) {}
  Mode mode;
  bool two_buses;
  bool fd;
  bool saved;  // the node restarts in this mode, not in forward mode
  bool begun;  // the correction has begun before the first event
};

class Events {
 public:
  explicit Events(std::span<const std::uint8_t> data) : data_(data) {}
  bool any() const { return !data_.empty(); }
  std::uint8_t byte() {
    if (data_.empty()) return 0;
    const std::uint8_t value = data_.front();
    data_ = data_.subspan(1);
    return value;
  }
  std::uint16_t word() { return static_cast<std::uint16_t>(byte() | byte() << 8); }
  void fill(std::span<std::uint8_t> bytes) {
    std::generate(bytes.begin(), bytes.end(), [this] { return byte(); });
  }

 private:
  std::span<const std::uint8_t> data_;
};

void require(bool condition) {
  if (!condition) std::abort();
}

CanFrame sdo_request(Events& events) {
  CanFrame frame;
  frame.id = 0x600 + NodeBench::kNodeId;
  frame.len = 8;
  events.fill(std::span(frame.data).first(8));
  const std::uint8_t choice = events.byte();
  if (choice % 10 != 0) {
    const std::size_t number = (choice * 257U + frame.data[1]) % od::kEntryCount;
    store_le(&frame.data[1], od::kEntries[number].index);
    frame.data[3] = static_cast<std::uint8_t>(frame.data[3] % 10);
  }
  return frame;
}

CanFrame any_frame(Events& events) {
  CanFrame frame;
  frame.flags = events.byte() & (kFrameExtended | kFrameRemote | kFrameFd | kFrameBitRateSwitch);
  frame.id = frame.is(kFrameExtended) ? events.word() * 8191U : events.word() & 0x7FFU;
  const std::size_t room = frame.is(kFrameFd) ? kFdPayload : kClassicPayload;
  frame.len = static_cast<std::uint8_t>(events.byte() % (room + 1));
  if (frame.is(kFrameFd)) {
    while (!is_valid_fd_length(frame.len)) ++frame.len;
  }
  events.fill(std::span(frame.data).first(frame.len));
  return frame;
}

CanFrame service_frame(Events& events, std::uint8_t kind) {
  switch (kind % 4) {
    case 0:
      return make_frame(0x80, {});
    case 1:
      return make_frame(0x000, {events.byte(), events.byte() % 2 == 0 ? 0 : NodeBench::kNodeId});
    case 2:
      return make_frame(0x700 + events.byte() % 128, {events.byte()});
    default: {
      CanFrame frame = make_frame(0x1C0 + events.byte() % 3, {0, 0, 0, 0, 0, 0, 0, 0});
      events.fill(std::span(frame.data).first(8));
      return frame;
    }
  }
}

// Checks that hold after any input.
void judge(NodeBench& bench) {
  for (const CanFrame& frame : bench.downstream.take_sent()) {
    require(frame.len <= (frame.is(kFrameFd) ? kFdPayload : kClassicPayload));
  }
  for (const CanFrame& frame : bench.upstream.take_sent()) {
    require(frame.len <= (frame.is(kFrameFd) ? kFdPayload : kClassicPayload));
  }
  const auto& node = bench.node();
  for (std::size_t axis = 0; axis < 6; ++axis) {
    // 0.05 turn of 2^20 increments: no input may ask for a larger correction.
    const std::int32_t offset = node.dictionary().get(od::axis::kPositionOffset[axis]);
    require(std::abs(offset) <= 52429);
  }
}

constexpr std::array<std::int32_t, 6> kStand = {230'000,  300'000, 150'000,
                                                -250'000, 270'000, -200'000};

// Sends targets repeatedly, and actual positions of an arm that stands at them: the first offsets
// wait for positions that come after the targets have been constant for 0.1 s.
void begin(NodeBench& bench, Mode mode) {
  for (int cycle = 0; cycle < 20; ++cycle) {
    bench.now_us += 10'000;
    bench.sync();
    for (std::uint32_t k = 0; k < 3; ++k) {
      const CanFrame frame = NodeBench::pair_frame(0x1C0 + k, kStand[2 * k], kStand[2 * k + 1]);
      mode == Mode::kInline ? bench.from_drives(frame) : bench.from_controller(frame);
    }
    bench.command_joints(kStand);
  }
  require(bench.node().dictionary().get(od::axis::kPositionOffset[0]) != 0);
}

void prepare(NodeBench& bench, const Setup& setup) {
  bench.configure(setup.mode);
  if (setup.saved) require(bench.write(0x1010, 1, kSave, 4) == 0);
  if (setup.begun) begin(bench, setup.mode);
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  // Uploading a table takes far longer than one input: a flash that holds a table is copied.
  static const armtrue::storage::SimulatedFlash prepared = [] {
    NodeBench bench(true, true, {}, kSlotSize);
    bench.install(TestTable{}.image());
    return bench.flash;
  }();
  if (size == 0) return 0;
  const Setup setup(data[size - 1]);
  NodeBench bench(setup.two_buses, setup.fd, {}, kSlotSize, &prepared);
  prepare(bench, setup);
  Events events({data, size - 1});
  while (events.any()) {
    const std::uint8_t event = events.byte();
    if (event < 96) {
      bench.upstream.deliver(sdo_request(events));
    } else if (event < 128) {
      CanFrame frame = NodeBench::targets({})[event % 3];
      events.fill(std::span(frame.data).first(8));
      bench.upstream.deliver(frame);
    } else if (event < 160) {
      const CanFrame frame = service_frame(events, event);
      (event % 8 < 6 ? bench.upstream : bench.downstream).deliver(frame);
    } else if (event < 192) {
      bench.upstream.deliver(any_frame(events));
    } else if (event < 208) {
      bench.downstream.deliver(any_frame(events));
    } else if (event < 240) {
      bench.now_us += events.word() * 100ULL;
    } else if (event < 248) {
      const bool upstream = setup.mode == Mode::kOffset && event < 244;
      (upstream ? bench.upstream : bench.downstream)
          .set_room(event % 4 == 3 ? SIZE_MAX : event % 8);
    } else if (event < 252) {
      (event % 2 == 0 ? bench.upstream : bench.downstream).set_state(BusState::kBusOff);
    } else {
      bench.power_on();
    }
    bench.turn();
    judge(bench);
  }
  return 0;
}
