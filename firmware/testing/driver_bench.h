// A node in inline mode between a simulated controller's bus and a driver of a port, whose
// registers a test models. SYNC and three target frames a millisecond, the same target for all six
// joints.
#ifndef ARMTRUE_FIRMWARE_TESTING_DRIVER_BENCH_H_
#define ARMTRUE_FIRMWARE_TESTING_DRIVER_BENCH_H_

#include <array>
#include <cstdint>
#include <vector>

#include "firmware/canopen/node/node.h"
#include "firmware/storage/simulated_flash.h"
#include "firmware/testing/node_bench.h"
#include "firmware/testing/simulated_port.h"

namespace armtrue::canopen {

class DriverBench {
 public:
  static constexpr std::uint32_t kSync = 0x80;
  static constexpr std::uint32_t kFirstTargets = 0x220;

  // `image`: the table in force, empty for none.
  explicit DriverBench(CanPort& drives, const std::vector<std::uint8_t>& image = {})
      : flash_(kMaxImageLength + storage::kHeaderBytes, 1),
        compensator_({.joint_count = 6, .cycle_us = 1000}),
        verifier_(identity_),
        store_(flash_, verifier_),
        node_(
            {.node_id = 0x20, .serial_number = 1, .joint_count = 6, .clock_us = &NodeBench::clock},
            {upstream, &drives, compensator_, store_, parameters_, identity_, {first_, second_}}) {
    if (!image.empty()) {
      std::span<const std::uint8_t> unused;
      store_.start(second_);
      store_.commit(image);
      store_.activate(second_, unused);
      store_.confirm();
    }
    node_.start(now_us);
    turn();
    for (int k = 0; k < 3; ++k) {
      deliver(make_frame(0x620, {0x23, k, 0x14, 1, 0x20, 2 + k, 0, 0}));
      deliver(make_frame(0x620, {0x23, 8 + k, 0x14, 1, 0xC0 + k, 1, 0, 0}));
    }
    deliver(make_frame(0x620, {0x2F, 0x00, 0x20, 1, 1, 0, 0, 0}));
    deliver(make_frame(0, {1, 0}));
  }

  void turn() { node_.process(now_us); }
  void deliver(const CanFrame& frame) {
    upstream.deliver(frame);
    turn();
  }
  void cycle(std::int32_t target) {
    now_us += 1000;
    deliver(make_frame(kSync, {}));
    for (std::uint32_t k = 0; k < 3; ++k) {
      deliver(NodeBench::pair_frame(kFirstTargets + 0x100 * k, target, target));
    }
  }
  const JointCounters& counters() const { return node_.joint_counters(); }

  SimulatedPort upstream;
  std::uint64_t now_us = 1'000'000;

 private:
  DeviceIdentity identity_ = {.joint_count = 6};
  MemoryParameters parameters_;
  storage::SimulatedFlash flash_;
  std::array<std::uint8_t, kMaxImageLength> first_ = {};
  std::array<std::uint8_t, kMaxImageLength> second_ = {};
  Compensator compensator_;
  IdentityVerifier verifier_;
  storage::SlotStore store_;
  Node node_;
};

}  // namespace armtrue::canopen

#endif  // ARMTRUE_FIRMWARE_TESTING_DRIVER_BENCH_H_
