// The watchdog is fed only while the joint path is supervised in time.
#include "firmware/ports/common/device.h"

#include <gtest/gtest.h>

#include <array>
#include <initializer_list>

#include "firmware/testing/node_bench.h"

namespace armtrue::ports {
namespace {

using canopen::make_frame;
using canopen::NodeBench;

constexpr std::uint64_t kMillisecond = 1000;

class WatchdogTest : public testing::Test {
 protected:
  WatchdogTest() { device_.start(); }

  // Runs one turn at the present time. Returns whether it fed the watchdog.
  bool turn() {
    bool fed = false;
    goes_on_ = device_.turn([&fed] { fed = true; });
    return fed;
  }
  bool turn_after(std::uint64_t pause_us) {
    now_us += pause_us;
    return turn();
  }
  void request(std::initializer_list<int> bytes) {
    upstream_.deliver(make_frame(0x600 + NodeBench::kNodeId, bytes));
    turn_after(kMillisecond);
  }
  void configure_inline() {
    for (int k = 0; k < 3; ++k) request({0x23, k, 0x14, 1, NodeBench::kNodeId, 2 + k, 0, 0});
    request({0x2F, 0x00, 0x20, 1, 1, 0, 0, 0});
    upstream_.deliver(make_frame(0, {1, 0}));
    turn_after(kMillisecond);
  }
  // Runs a cycle of 1 ms. Returns whether its set reached the drives and the watchdog was fed.
  bool cycle(std::int32_t position) {
    upstream_.deliver(make_frame(0x80, {}));
    const std::array<std::int32_t, 6> joints = {position, position, position,
                                                position, position, position};
    for (const canopen::CanFrame& frame : NodeBench::targets(joints)) upstream_.deliver(frame);
    const bool fed = turn_after(kMillisecond);
    return fed && downstream_.take_sent().size() == 4;
  }

  canopen::PortHealth health_{
      .reset_cause = 9, .fault_instruction = 0x08001234, .option_bytes = 0x0FFFAAED};
  static inline std::uint64_t now_us = 1'000'000;
  static std::uint64_t clock() { return now_us; }
  bool goes_on_ = true;
  canopen::SimulatedPort upstream_;
  canopen::SimulatedPort downstream_;

 private:
  storage::SimulatedFlash flash_{kMaxImageLength + storage::kHeaderBytes, 1};
  canopen::MemoryParameters parameters_;
  // Outlives the device, as in a firmware image.
  const DeviceSettings settings_{.identity = {.robot_serial = {}, .joint_count = 6},
                                 .node_id = NodeBench::kNodeId,
                                 .serial_number = 1,
                                 .cycle_us = 1000};
  Device device_{settings_, {upstream_, &downstream_, flash_, parameters_, &clock, &health_}};
};

TEST_F(WatchdogTest, IsFedAtRestInMotionAndWhenCommandsStop) {
  turn();
  for (int k = 0; k < 100; ++k) EXPECT_TRUE(turn_after(kMillisecond));
  configure_inline();
  downstream_.take_sent();
  cycle(0);
  for (int k = 1; k < 100; ++k) EXPECT_TRUE(cycle(20 * k)) << k;
  for (int k = 0; k < 200; ++k) EXPECT_TRUE(turn_after(kMillisecond)) << "interrupted and reported";
}

TEST_F(WatchdogTest, IsNotFedByATurnThatComesLate) {
  turn();
  EXPECT_TRUE(turn_after(canopen::JointPath::kSupervisionUs));
  EXPECT_FALSE(turn_after(canopen::JointPath::kSupervisionUs + 1));
  EXPECT_TRUE(turn_after(kMillisecond)) << "supervised again";
  for (int k = 0; k < 20; ++k) {
    EXPECT_FALSE(turn_after(3 * canopen::JointPath::kSupervisionUs / 2)) << "it would starve";
  }
}

TEST_F(WatchdogTest, Object2040_ReportsThePortsHealth) {
  turn();
  turn_after(kMillisecond);
  upstream_.take_sent();
  const auto read = [this](int sub) {
    request({0x40, 0x40, 0x20, sub, 0, 0, 0, 0});
    for (const canopen::CanFrame& frame : upstream_.take_sent()) {
      if (frame.id == 0x580 + NodeBench::kNodeId) {
        return canopen::load_le<std::uint32_t>(&frame.data[4]);
      }
    }
    return UINT32_MAX;
  };
  EXPECT_EQ(read(1), 9U);
  EXPECT_EQ(read(4), 0x08001234U);
  EXPECT_EQ(read(7), 0x0FFFAAEDU);
  EXPECT_EQ(read(9), 0U);
  health_.supply_dips = 3;
  EXPECT_EQ(read(9), 3U);
}

TEST_F(WatchdogTest, IsNotFedByATurnWithAnNmtReset) {
  turn();
  ASSERT_TRUE(turn_after(kMillisecond));
  upstream_.deliver(make_frame(0, {130, 0}));
  EXPECT_FALSE(turn_after(kMillisecond)) << "the joint path was not looked at";
  EXPECT_TRUE(goes_on_);
  EXPECT_TRUE(turn_after(kMillisecond));
  upstream_.deliver(make_frame(0, {129, 0}));
  EXPECT_FALSE(turn_after(kMillisecond));
  EXPECT_FALSE(goes_on_);
}

}  // namespace
}  // namespace armtrue::ports
