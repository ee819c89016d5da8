// A whole node on two simulated buses and simulated flash, with a clock that the test sets.
#ifndef ARMTRUE_FIRMWARE_TESTING_NODE_BENCH_H_
#define ARMTRUE_FIRMWARE_TESTING_NODE_BENCH_H_

#include <array>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <stdexcept>
#include <vector>

#include "firmware/canopen/node/node.h"
#include "firmware/storage/simulated_flash.h"
#include "firmware/testing/simulated_port.h"

namespace armtrue::canopen {

// Signatures that a client writes to 1010h and 1011h (CiA 301, 7.5.2.13 f.), and the abort code of
// a request that the device's state forbids.
inline constexpr std::uint32_t kSave = 0x65766173;  // "save"
inline constexpr std::uint32_t kLoad = 0x64616F6C;  // "load"
inline constexpr std::uint32_t kDeviceState = static_cast<std::uint32_t>(Abort::kDeviceState);
// Statuswords of a drive (CiA 402).
inline constexpr int kOperationEnabled = 0x0237;
inline constexpr int kSwitchOnDisabled = 0x0250;

// The parameter block of 0x1010 in RAM; kept over a restart.
class MemoryParameters final : public ParameterStore {
 public:
  bool load(std::span<std::uint8_t> block) override {
    if (block_.size() != block.size()) return false;
    std::copy(block_.begin(), block_.end(), block.begin());
    return true;
  }
  bool holds_something() const override { return !block_.empty(); }
  // Flips a bit of the saved block.
  void spoil(std::size_t at) { block_.at(at) ^= 1; }
  bool save(std::span<const std::uint8_t> block) override {
    if (broken) return false;
    if (meanwhile) meanwhile();
    block_.assign(block.begin(), block.end());
    return true;
  }
  bool erase() override {
    block_.clear();
    return !broken;
  }
  bool broken = false;
  std::function<void()> meanwhile;  // called during a save

 private:
  std::vector<std::uint8_t> block_;
};

class NodeBench {
 public:
  static constexpr std::uint8_t kNodeId = 0x20;

  // `content`: the initial content of the flash; without it the flash is blank.
  explicit NodeBench(bool two_buses = true, bool fd = false, const DeviceIdentity& identity = {},
                     std::size_t slot_size = kMaxImageLength + storage::kHeaderBytes,
                     const storage::SimulatedFlash* content = nullptr)
      : device(identity), upstream(fd), downstream(fd), flash(slot_size, 1), two_buses_(two_buses) {
    if (content != nullptr) flash = *content;
    device.joint_count = 6;
    power_on();
  }

  // Restarts the node with new RAM; flash and parameters are kept.
  void power_on() {
    ++lives;
    upstream.recover();  // a reset puts the controllers back on the bus
    downstream.recover();
    life_.reset();
    life_ = std::make_unique<Life>(*this);
    life_->node.start(now_us);
    run_for(0);
  }

  // One turn of the main loop at the present time. A reset request is carried out.
  void turn() {
    if (life_->node.process(now_us) == NodeAction::kRestart) power_on();
  }

  // Lets time pass in steps of a millisecond, turning the loop at each, and once at the end.
  void run_for(std::uint64_t duration_us, std::uint64_t step_us = 1000) {
    const std::uint64_t end_us = now_us + duration_us;
    turn();
    while (now_us < end_us) {
      now_us = std::min(end_us, now_us + step_us);
      turn();
    }
  }

  // Turns the loop at the present time until nothing more is sent upstream, and returns all that
  // was: a block upload sends a few segments per turn.
  std::vector<CanFrame> all_sent() {
    std::vector<CanFrame> all;
    for (std::vector<CanFrame> frames = upstream.take_sent(); !frames.empty();
         frames = upstream.take_sent()) {
      all.insert(all.end(), frames.begin(), frames.end());
      turn();
    }
    return all;
  }

  // Delivers a frame from the controller's side and turns the loop.
  void from_controller(const CanFrame& frame) {
    upstream.deliver(frame);
    turn();
  }
  void from_drives(const CanFrame& frame) {
    downstream.deliver(frame);
    turn();
  }

  // One SDO request and its response frame's payload; the other frames sent meanwhile are kept in
  // `aside`.
  std::array<std::uint8_t, 8> ask(std::initializer_list<int> request) {
    from_controller(make_frame(0x600 + kNodeId, request));
    std::array<std::uint8_t, 8> answer = {};
    bool answered = false;
    for (const CanFrame& frame : upstream.take_sent()) {
      if (frame.id == 0x580 + kNodeId && !answered) {
        std::copy_n(frame.data, 8, answer.begin());
        answered = true;
      } else {
        aside.push_back(frame);
      }
    }
    if (!answered) throw std::runtime_error("no SDO response");
    return answer;
  }

  // Expedited download. Returns the abort code, 0 for success.
  std::uint32_t write(std::uint16_t index, std::uint8_t sub, std::uint32_t value, int size) {
    const int command = 0x23 | (4 - size) << 2;
    const auto answer = ask({command, index & 0xFF, index >> 8, sub, static_cast<int>(value & 0xFF),
                             static_cast<int>(value >> 8 & 0xFF),
                             static_cast<int>(value >> 16 & 0xFF), static_cast<int>(value >> 24)});
    return answer[0] == 0x80 ? load_le<std::uint32_t>(&answer[4]) : 0;
  }

  // Expedited upload; throws if the node aborts.
  std::uint32_t read(std::uint16_t index, std::uint8_t sub) {
    const auto answer = ask({0x40, index & 0xFF, index >> 8, sub, 0, 0, 0, 0});
    if ((answer[0] & 0xE0) != 0x40) throw std::runtime_error("upload refused");
    std::uint32_t value = load_le<std::uint32_t>(&answer[4]);
    const int unused = answer[0] >> 2 & 3;
    return unused == 0 ? value : value & (0xFFFFFFFFU >> (8 * unused));
  }

  // Segmented download into the staging object. Returns the abort code, 0 for success.
  std::uint32_t stage(std::span<const std::uint8_t> image) {
    const auto size = static_cast<std::uint32_t>(image.size());
    auto answer = ask({0x21, 0x10, 0x20, 0, static_cast<int>(size & 0xFF),
                       static_cast<int>(size >> 8 & 0xFF), static_cast<int>(size >> 16), 0});
    int toggle = 0;
    for (std::size_t at = 0; answer[0] != 0x80 && at < image.size(); at += 7) {
      const std::size_t length = std::min<std::size_t>(7, image.size() - at);
      std::array<int, 7> data = {};
      for (std::size_t k = 0; k < length; ++k) data[k] = image[at + k];
      const int command =
          toggle | static_cast<int>(7 - length) << 1 | (at + length == image.size());
      answer = ask({command, data[0], data[1], data[2], data[3], data[4], data[5], data[6]});
      toggle ^= 0x10;
    }
    return answer[0] == 0x80 ? load_le<std::uint32_t>(&answer[4]) : 0;
  }

  std::uint32_t command(TableCommand word) {
    return write(0x2012, 0, static_cast<std::uint32_t>(word), 4);
  }

  // Stage, verify and commit; put_on_trial() activates as well, install() confirms. All throw at
  // the first refusal.
  void commit(std::span<const std::uint8_t> image) {
    if (stage(image) != 0) throw std::runtime_error("staging refused");
    require(TableCommand::kVerify);
    require(TableCommand::kCommit);
  }
  void put_on_trial(std::span<const std::uint8_t> image) {
    commit(image);
    require(TableCommand::kActivate);
  }
  void install(std::span<const std::uint8_t> image) {
    put_on_trial(image);
    require(TableCommand::kConfirm);
  }

  // Configures two offsets per frame, TPDO1 to TPDO3 on 0x1A0, 0x2A0, 0x3A0.
  void send_offsets() {
    for (std::uint32_t k = 0; k < 3; ++k) {
      expect_done(write(static_cast<std::uint16_t>(0x1800 + k), 1, 0x400001A0U + 0x100U * k, 4));
    }
  }
  // Configures two targets per frame, RPDO1 to RPDO3 on 0x220, 0x320, 0x420, in offset mode also
  // the offsets as above, and starts the node.
  void configure(Mode mode) {
    for (int k = 0; k < 3; ++k) {
      expect_done(write(static_cast<std::uint16_t>(0x1400 + k), 1,
                        0x200U + 0x100U * static_cast<unsigned>(k) + kNodeId, 4));
      expect_done(
          write(static_cast<std::uint16_t>(0x1408 + k), 1, 0x1C0U + static_cast<unsigned>(k), 4));
    }
    if (mode == Mode::kOffset) send_offsets();
    expect_done(write(0x2000, 1, static_cast<std::uint32_t>(mode), 1));
    start_nodes();
  }
  void start_nodes() { from_controller(make_frame(0x000, {1, 0})); }
  // An NMT command.
  void nmt(int command, int node = kNodeId) { from_controller(make_frame(0, {command, node})); }
  void sync() { from_controller(make_frame(0x80, {})); }
  // SYNC a millisecond later.
  void next_sync() {
    now_us += 1000;
    sync();
  }
  // Transmission type of three PDOs from this communication record on; 1: with each SYNC.
  void set_transmission(std::uint16_t record, std::uint32_t type = 1) {
    for (std::uint16_t k = 0; k < 3; ++k) {
      expect_done(write(static_cast<std::uint16_t>(record + k), 2, type, 1));
    }
  }
  // Frames with this identifier among those that left upstream.
  std::vector<CanFrame> sent(std::uint32_t id) {
    std::vector<CanFrame> frames = upstream.take_sent();
    std::erase_if(frames, [id](const CanFrame& frame) { return frame.id != id; });
    return frames;
  }

  static CanFrame pair_frame(std::uint32_t id, std::int32_t first, std::int32_t second) {
    CanFrame frame;
    frame.id = id;
    frame.len = 8;
    store_le(&frame.data[0], first);
    store_le(&frame.data[4], second);
    return frame;
  }
  // The three target frames of a cycle.
  static std::array<CanFrame, 3> targets(const std::array<std::int32_t, 6>& joint) {
    return {pair_frame(0x220, joint[0], joint[1]), pair_frame(0x320, joint[2], joint[3]),
            pair_frame(0x420, joint[4], joint[5])};
  }
  void command_joints(const std::array<std::int32_t, 6>& joint) {
    for (const CanFrame& frame : targets(joint)) from_controller(frame);
  }

  // The clock with which the node measures cycles; every reading advances it by `clock_step_us`.
  // All benches share it, and all run in one thread.
  static inline std::uint64_t clock_now_us = 0;
  static inline std::uint64_t clock_step_us = 0;
  static std::uint64_t clock() { return clock_now_us += clock_step_us; }

  // Flips a bit in both table buffers in RAM.
  void spoil_tables(std::size_t at) {
    life_->first[at] ^= 1;
    life_->second[at] ^= 1;
  }

  Node& node() { return life_->node; }
  Compensator& compensator() { return life_->compensator; }
  storage::SlotStore& store() { return life_->store; }

  DeviceIdentity device;
  SimulatedPort upstream;
  SimulatedPort downstream;
  storage::SimulatedFlash flash;
  MemoryParameters parameters;
  const PortHealth* health = nullptr;  // from the next power_on() on
  std::uint32_t cycle_us = 1000;       // control period, likewise
  std::uint64_t now_us = 1'000'000;
  std::vector<CanFrame> aside;
  std::uint64_t lives = 0;  // power-ons and NMT node resets

 private:
  struct Life {
    explicit Life(NodeBench& bench)
        : compensator({.joint_count = 6, .cycle_us = bench.cycle_us}),
          verifier(bench.device),
          store(bench.flash, verifier),
          node({.node_id = kNodeId, .serial_number = 7, .joint_count = 6, .clock_us = &clock},
               {bench.upstream,
                bench.two_buses_ ? &bench.downstream : nullptr,
                compensator,
                store,
                bench.parameters,
                bench.device,
                {first, second},
                bench.health}) {}
    std::array<std::uint8_t, kMaxImageLength> first = {};
    std::array<std::uint8_t, kMaxImageLength> second = {};
    Compensator compensator;
    IdentityVerifier verifier;
    storage::SlotStore store;
    Node node;
  };

  void require(TableCommand word) {
    if (command(word) != 0) throw std::runtime_error("table command refused");
  }
  static void expect_done(std::uint32_t abort) {
    if (abort != 0) throw std::runtime_error("configuration refused");
  }

  bool two_buses_;
  std::unique_ptr<Life> life_;
};

}  // namespace armtrue::canopen

#endif  // ARMTRUE_FIRMWARE_TESTING_NODE_BENCH_H_
