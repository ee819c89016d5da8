// Status objects of the node (0x2001 to 0x2006, 0x2040) against what it has done.
#include <gtest/gtest.h>

#include <optional>
#include <string>
#include <utility>

#include "firmware/testing/node_bench.h"
#include "firmware/testing/test_table.h"

namespace armtrue::canopen {
namespace {

constexpr std::uint32_t kConfigured = 1U << 0;
constexpr std::uint32_t kStreaming = 1U << 1;
constexpr std::uint32_t kOnTrial = 1U << 2;
constexpr std::uint32_t kQuiet = 1U << 3;
constexpr std::uint32_t kDrivesUnknown = 1U << 4;
constexpr std::uint32_t kUnsaved = 1U << 5;

class StatusTest : public testing::Test {
 protected:
  ~StatusTest() override { NodeBench::clock_step_us = 0; }

  void start(const TestTable& table = {}) {
    bench.install(table.image());
    bench.configure(Mode::kInline);
  }
  // One control cycle: SYNC, actual positions equal to the last targets, then new targets, of which
  // joint k has k times `joint`.
  void cycle(std::int32_t joint) {
    std::array<std::int32_t, 6> targets = {};
    for (std::size_t k = 0; k < 6; ++k) targets[k] = joint * static_cast<std::int32_t>(k + 1);
    const auto joints = std::exchange(commanded, targets).value_or(targets);
    bench.next_sync();
    for (std::uint32_t pair = 0; pair < 3; ++pair) {
      bench.from_drives(
          NodeBench::pair_frame(0x1C0 + pair, joints[2 * pair], joints[2 * pair + 1]));
    }
    bench.command_joints(targets);
  }
  std::uint32_t bits() {
    const std::uint32_t found = bench.read(0x2001, 2);
    EXPECT_EQ(bench.read(0x1002, 0), found) << "the manufacturer's status register";
    return found;
  }
  std::uint32_t status(std::uint8_t sub) { return bench.read(0x2001, sub); }

  NodeBench bench;
  std::optional<std::array<std::int32_t, 6>> commanded;
};

TEST_F(StatusTest, JustStartedDevice_HasCountersAtZero) {
  EXPECT_EQ(bench.read(0x2002, 2), 1U) << "received: this request";
  for (const int sub : {1, 3, 4, 5, 6, 7, 8, 9, 10, 11, 14, 15, 16}) {
    EXPECT_EQ(status(static_cast<std::uint8_t>(sub)), 0U) << sub;
  }
  for (std::uint8_t sub = 1; sub <= 4; ++sub) EXPECT_EQ(bench.read(0x2013, sub), 0U) << int{sub};
  for (std::uint8_t sub = 13; sub <= 17; ++sub) EXPECT_EQ(bench.read(0x2013, sub), 0U) << int{sub};
}

TEST_F(StatusTest, StatusBits_ChangeIndependently) {
  EXPECT_EQ(bits(), kQuiet | kDrivesUnknown) << "as delivered";
  bench.put_on_trial(TestTable{}.image());
  EXPECT_EQ(bits(), kQuiet | kDrivesUnknown | kOnTrial);
  ASSERT_EQ(bench.command(TableCommand::kConfirm), 0U);
  EXPECT_EQ(bits(), kQuiet | kDrivesUnknown);
  bench.configure(Mode::kInline);
  EXPECT_EQ(bits(), kQuiet | kDrivesUnknown | kConfigured | kUnsaved);
  ASSERT_EQ(bench.write(0x1010, 1, kSave, 4), 0U);
  EXPECT_EQ(bits(), kQuiet | kDrivesUnknown | kConfigured);
  for (int k = 0; k < 3; ++k) cycle(1000);
  EXPECT_EQ(bits(), kConfigured | kStreaming);
  bench.run_for(600'000);
  EXPECT_EQ(bits(), kConfigured | kQuiet);
  bench.power_on();
  ASSERT_EQ(bench.write(0x1400, 1, 0x80000220, 4), 0U);
  EXPECT_EQ(bits(), kQuiet | kDrivesUnknown | kUnsaved) << "a joint has no target any more";
}

TEST_F(StatusTest, TargetsInForwardMode_ClearTheQuietBit) {
  bench.configure(Mode::kForward);
  cycle(1000);
  ASSERT_EQ(bench.write(0x1400, 1, 0x80000220, 4), 0U);
  EXPECT_EQ(bits(), kDrivesUnknown | kUnsaved);
}

TEST_F(StatusTest, QuietTime_IsExact) {
  ASSERT_EQ(bench.write(0x2000, 5, 200, 4), 0U);
  start();
  cycle(1000);
  bench.run_for(199'999);
  EXPECT_EQ(bits() & kQuiet, 0U);
  bench.run_for(1);
  EXPECT_EQ(bits() & kQuiet, kQuiet);
}

TEST_F(StatusTest, State_IsThatOfTheCorrection) {
  EXPECT_EQ(status(1), 0U);
  start();
  cycle(1000);
  cycle(1000);
  EXPECT_EQ(status(1), static_cast<std::uint32_t>(CompensatorState::kBlending));
  for (int k = 0; k < 100; ++k) cycle(1000);
  EXPECT_EQ(status(1), static_cast<std::uint32_t>(CompensatorState::kActive));
}

TEST_F(StatusTest, Counters_AreThoseOfTheJointPath) {
  EXPECT_EQ(status(12), 6U) << "joints";
  start();
  for (int k = 0; k < 10; ++k) cycle(1000 * k);
  const auto frames = NodeBench::targets({});
  bench.from_controller(frames[0]);  // two targets for one joint in this interval
  bench.sync();
  bench.from_controller(frames[1]);
  bench.from_controller(frames[1]);
  bench.from_controller(make_frame(0x320 + 0x100, {1, 2, 3}));
  bench.run_for(30'000);
  const JointCounters& counters = bench.node().joint_counters();
  EXPECT_EQ(counters.sets, 9U) << "a stream begins with its second set";
  EXPECT_EQ(status(3), counters.sets);
  EXPECT_EQ(counters.stale, 1U);
  EXPECT_EQ(status(5), counters.stale);
  EXPECT_EQ(counters.withheld, 2U);
  EXPECT_EQ(status(8), counters.withheld);
  EXPECT_EQ(counters.repeated, 1U);
  EXPECT_EQ(status(9), counters.repeated);
  EXPECT_EQ(counters.malformed, 1U);
  EXPECT_EQ(status(10), counters.malformed);
  EXPECT_EQ(counters.conflicts, 1U);
  EXPECT_EQ(status(16), counters.conflicts);
}

TEST_F(StatusTest, RefusedWritesAndTables_AreAddedUp) {
  EXPECT_NE(bench.write(0x2001, 1, 0, 1), 0U) << "read-only";
  EXPECT_EQ(status(6), 1U);
  ASSERT_EQ(bench.stage(std::vector<std::uint8_t>(300)), 0U);
  EXPECT_NE(bench.command(TableCommand::kVerify), 0U);
  EXPECT_EQ(status(6), 2U);
}

TEST_F(StatusTest, ClampedCycles_AreCountedForEachAxis) {
  start(TestTable{.rate = kMaxRateRevolute / 40});
  for (int k = 0; k < 100; ++k) cycle(20'000 * k);
  const CycleCounters& cycles = bench.compensator().counters();
  EXPECT_EQ(status(4), cycles.magnitude_clamped + cycles.rate_clamped + cycles.output_saturated);
  EXPECT_NE(status(15), 0U) << "which clamps, in the last cycle";
  for (std::uint8_t axis = 0; axis < 6; ++axis) {
    EXPECT_NE(cycles.clamped[axis], 0U) << int{axis};
    EXPECT_EQ(bench.read(0x2004, static_cast<std::uint8_t>(axis + 1)), cycles.clamped[axis]);
  }
}

TEST_F(StatusTest, DemandedPositions_AreTheTargetsSentToTheDrives) {
  start();
  for (int k = 0; k < 50; ++k) cycle(1000);
  bench.downstream.take_sent();
  cycle(1000);
  std::size_t found = 0;
  for (const CanFrame& frame : bench.downstream.take_sent()) {
    if (frame.id != 0x320) continue;
    ++found;
    EXPECT_EQ(bench.read(0x7062, 0), load_le<std::uint32_t>(&frame.data[0])) << "axis 3";
    EXPECT_EQ(bench.read(0x7862, 0), load_le<std::uint32_t>(&frame.data[4])) << "axis 4";
    EXPECT_EQ(bench.read(0x70B0, 0), load_le<std::uint32_t>(&frame.data[0]) - 3000U);
  }
  EXPECT_EQ(found, 1U);
}

TEST_F(StatusTest, WorstCycle_IsTheLongestMeasured) {
  start();
  NodeBench::clock_step_us = 3;
  for (int k = 0; k < 3; ++k) cycle(1000);
  EXPECT_EQ(status(7), 3U);
  NodeBench::clock_step_us = 7;
  cycle(1000);
  NodeBench::clock_step_us = 5;
  cycle(1000);
  EXPECT_EQ(status(7), 7U) << "the worst stays";
}

// Each group of four sub-indices has minimum, median, 99.9 % and maximum.
TEST_F(StatusTest, Timing_ReportsLatencyOfSyncAndTargets) {
  start();
  NodeBench::clock_step_us = 2;
  for (int k = 0; k < 100; ++k) cycle(1000);
  NodeBench::clock_step_us = 5;
  cycle(1000);
  NodeBench::clock_step_us = 1;
  cycle(1000);
  NodeBench::clock_step_us = 0;
  const auto timing = [this](std::uint8_t sub) { return bench.read(0x2006, sub); };
  EXPECT_EQ(timing(1), 1U) << "SYNC latency: two readings";
  EXPECT_EQ(timing(2), 2U);
  EXPECT_EQ(timing(3), 5U);
  EXPECT_EQ(timing(4), 5U);
  EXPECT_EQ(timing(5), 0U) << "its jitter, from each to the next";
  EXPECT_EQ(timing(6), 0U);
  EXPECT_EQ(timing(7), 4U);
  EXPECT_EQ(timing(8), 4U);
  EXPECT_EQ(timing(9), 3U) << "target latency: three readings behind the first";
  EXPECT_EQ(timing(10), 6U);
  EXPECT_EQ(timing(11), 15U);
  EXPECT_EQ(timing(12), 15U);
  EXPECT_EQ(timing(13), 500U) << "the set window";
}

TEST_F(StatusTest, StartAndSupply_AreReportedFromThePort) {
  for (std::uint8_t sub = 1; sub <= 9; ++sub) EXPECT_EQ(bench.read(0x2040, sub), 0U);
  const PortHealth health = {.reset_cause = 1,
                             .starts = 2,
                             .history = 3,
                             .fault_instruction = 4,
                             .fault_status = 5,
                             .fault_address = 6,
                             .option_bytes = 7,
                             .protection = 8,
                             .supply_dips = 9};
  const PortHealth nothing;
  bench.health = &nothing;
  bench.power_on();
  for (std::uint8_t sub = 1; sub <= 9; ++sub) EXPECT_EQ(bench.read(0x2040, sub), 0U);
  bench.health = &health;
  bench.power_on();
  for (std::uint8_t sub = 1; sub <= 9; ++sub) EXPECT_EQ(bench.read(0x2040, sub), sub);
}

TEST_F(StatusTest, IdentityAndSerial_AreThoseOfTheDevice) {
  EXPECT_EQ(bench.read(0x1018, 4), 7U);
  DeviceIdentity device;
  const std::string serial = "R1";
  serial.copy(device.robot_serial.data(), device.robot_serial.size());
  NodeBench named(true, false, device);
  EXPECT_EQ(named.read(0x2014, 0), 0x3152U) << "\"R1\"";
  named.from_controller(make_frame(0, {130, NodeBench::kNodeId}));
  EXPECT_EQ(named.read(0x2014, 0), 0x3152U) << "and so it stays";
  EXPECT_EQ(named.read(0x1018, 4), 7U);
}

}  // namespace
}  // namespace armtrue::canopen
