// A stop command in a target frame reaches its drive even if the frame's set does not go out. No
// set that goes out has targets of two cycles, also with stop commands or after a single fault.
#include <gtest/gtest.h>

#include <random>
#include <set>
#include <tuple>
#include <utility>

#include "firmware/canopen/motion/stop_forwarder.h"
#include "firmware/testing/node_bench.h"
#include "firmware/testing/test_table.h"

namespace armtrue::canopen {
namespace {

constexpr int kOperation = 0x000F;
constexpr int kQuickStop = 0x0002;
constexpr int kHalt = 0x010F;
constexpr int kShutdown = 0x0006;
constexpr int kSwitchOn = 0x0007;
using Joints = std::array<std::int32_t, 6>;

struct Drive {
  int controlword = -1;
  std::int32_t target = 0;
  int frames = 0;
};

// One RPDO per drive on 0x301 to 0x306: controlword, target.
class StopTest : public testing::Test {
 protected:
  StopTest() {
    bench.install(TestTable{}.image());
    for (unsigned axis = 0; axis < 6; ++axis) map(axis, {axis});
    EXPECT_EQ(bench.write(0x2000, 1, 1, 1), 0U);
    bench.start_nodes();
    take();
  }

  // RPDO `rpdo`, counted from zero, holds controlword and target of these axes.
  void map(unsigned rpdo, std::initializer_list<unsigned> axes) {
    const auto record = static_cast<std::uint16_t>(0x1400 + rpdo);
    const auto mapping = static_cast<std::uint16_t>(0x1600 + rpdo);
    bench.write(record, 1, 0x80000301 + rpdo, 4);
    EXPECT_EQ(bench.write(mapping, 0, 0, 1), 0U);
    std::uint8_t sub = 0;
    for (const unsigned axis : axes) {
      EXPECT_EQ(bench.write(mapping, ++sub, 0x60400010 + 0x08000000 * axis, 4), 0U);
      EXPECT_EQ(bench.write(mapping, ++sub, 0x607A0020 + 0x08000000 * axis, 4), 0U);
    }
    EXPECT_EQ(bench.write(mapping, 0, sub, 1), 0U);
    EXPECT_EQ(bench.write(record, 1, 0x301 + rpdo, 4), 0U);
  }

  CanFrame frame(std::size_t axis, int controlword) const {
    CanFrame made = make_frame(static_cast<int>(0x301 + axis), {0, 0, 0, 0, 0, 0});
    store_le(&made.data[0], static_cast<std::uint16_t>(controlword));
    store_le(&made.data[2], target[axis]);
    return made;
  }
  void send(std::size_t axis, int controlword) {
    bench.from_controller(frame(axis, controlword));
    take();
  }
  void pass_time(std::uint64_t us = 1000) {
    bench.now_us += us;
    bench.turn();
    if (has_sync) bench.sync();
    take();
  }
  void cycle(int controlword, std::size_t absent = 6) {
    for (std::int32_t& joint : target) joint += 100;
    pass_time();
    for (std::size_t axis = 0; axis < 6; ++axis) {
      if (axis != absent) send(axis, controlword);
    }
  }
  void run(int cycles) {
    for (int k = 0; k < cycles; ++k) cycle(kOperation);
    ASSERT_EQ(drives[0].controlword, kOperation);
    for (Drive& drive : drives) drive.frames = 0;
  }
  virtual void take() {
    for (const CanFrame& sent : bench.downstream.take_sent()) {
      if (sent.id < 0x301 || sent.id > 0x306 || sent.len != 6) continue;
      Drive& drive = drives[sent.id - 0x301];
      drive.controlword = load_le<std::uint16_t>(&sent.data[0]);
      drive.target = load_le<std::int32_t>(&sent.data[2]);
      ++drive.frames;
    }
  }
  std::array<std::int32_t, 6> held() const {
    std::array<std::int32_t, 6> targets = {};
    for (std::size_t k = 0; k < 6; ++k) targets[k] = drives[k].target;
    return targets;
  }
  void expect_all(int controlword) {
    for (const Drive& drive : drives) EXPECT_EQ(drive.controlword, controlword);
  }

  NodeBench bench;
  bool has_sync = true;
  Joints target = {230'000, 300'000, 150'000, -250'000, 270'000, -200'000};
  std::array<Drive, 6> drives = {};
};

TEST_F(StopTest, QuickStopAfterTheFramesOfItsCycle_PassesAtOnceWithoutAnError) {
  run(50);
  const Joints before = held();
  for (std::size_t axis = 0; axis < 6; ++axis) {
    send(axis, kQuickStop);
    EXPECT_EQ(drives[axis].controlword, kQuickStop) << axis;
  }
  EXPECT_EQ(held(), before);
  cycle(kQuickStop);
  expect_all(kQuickStop);
  EXPECT_NE(held(), before) << "equal targets spoil no set";
  EXPECT_EQ(bench.read(0x1001, 0), 0U);
}

TEST_F(StopTest, QuickStopAfterTheFramesOfItsCycleWithoutSync_PassesAtOnce) {
  has_sync = false;
  run(50);
  const Joints before = held();
  send(4, kQuickStop);
  EXPECT_EQ(drives[4].controlword, kQuickStop);
  EXPECT_EQ(held(), before);
  cycle(kQuickStop);
  expect_all(kQuickStop);
  EXPECT_NE(held(), before) << "no interval begins with the repeated target";
}

TEST_F(StopTest, QuickStopWithOtherTargets_PassesAndReportsTheContradiction) {
  run(50);
  const Joints before = held();
  target[2] += 5;
  send(2, kQuickStop);
  EXPECT_EQ(drives[2].controlword, kQuickStop);
  EXPECT_EQ(held(), before);
  EXPECT_EQ(bench.read(0x1003, 1) & 0xFFFFU, 0xFF14U);
}

TEST_F(StopTest, QuickStopWhileADriveIsMissing_PassesInEveryCycle) {
  for (const bool sync : {true, false}) {
    has_sync = sync;
    run(50);
    const Joints before = held();
    for (int k = 0; k < 100; ++k) cycle(kQuickStop, 2);
    for (const std::size_t axis : {0U, 1U, 3U, 4U, 5U}) {
      EXPECT_EQ(drives[axis].controlword, kQuickStop);
      EXPECT_GE(drives[axis].frames, 99) << "one that was lost is repeated";
      EXPECT_LE(drives[axis].frames, 101);
    }
    EXPECT_EQ(held(), before) << "no set was whole: no new target";
    EXPECT_EQ(drives[2].frames, 0);
  }
}

TEST_F(StopTest, DrivesEnabledOneByOne_PassAllButTheEnablingFrame) {
  for (const int controlword : {kShutdown, kSwitchOn}) {
    for (std::size_t axis = 0; axis < 6; ++axis) {
      pass_time(20'000);
      send(axis, controlword);
      EXPECT_EQ(drives[axis].controlword, controlword);
    }
  }
  for (std::size_t axis = 0; axis < 6; ++axis) {
    pass_time(20'000);
    send(axis, kOperation);
  }
  expect_all(kSwitchOn);
  cycle(kOperation);
  cycle(kOperation);
  expect_all(kOperation);
}

TEST_F(StopTest, HaltOfOneDrive_KeepsItsLastTarget) {
  run(50);
  pass_time();
  const Joints before = held();
  target[0] += 12'345;
  send(0, kHalt);
  EXPECT_EQ(drives[0].controlword, kHalt);
  EXPECT_EQ(held(), before) << "corrected";
}

TEST_F(StopTest, OneSetAfterAPause_Passes) {
  for (const bool sync : {true, false}) {
    has_sync = sync;
    run(50);
    for (int k = 0; k < 1000; ++k) pass_time();
    for (std::size_t axis = 0; axis < 6; ++axis) send(axis, kShutdown);
    expect_all(kShutdown);
  }
}

TEST_F(StopTest, WholeSetsThatStop_AreSentOnce) {
  run(50);
  for (int k = 0; k < 10; ++k) cycle(kQuickStop);
  for (Drive& drive : drives) drive.frames = 0;
  for (int k = 0; k < 10; ++k) cycle(kQuickStop);
  for (const Drive& drive : drives) EXPECT_EQ(drive.frames, 10);
}

TEST_F(StopTest, SynchronousTargets_DoNotWaitForSync) {
  for (std::uint16_t k = 0; k < 6; ++k) {
    EXPECT_EQ(bench.write(static_cast<std::uint16_t>(0x1400 + k), 2, 1, 1), 0U);
  }
  run(50);
  cycle(kOperation);
  send(3, kQuickStop);
  EXPECT_EQ(drives[3].controlword, kQuickStop);
  pass_time();
  EXPECT_EQ(drives[3].controlword, kQuickStop) << "nor does the set that waited take it back";
  EXPECT_EQ(drives[2].controlword, kOperation);
}

TEST_F(StopTest, NodeNotOperational_StopsPassAndTargetsDoNot) {
  run(50);
  bench.nmt(128);
  const Joints before = held();
  for (int k = 0; k < 3; ++k) cycle(kOperation);
  for (int k = 0; k < 3; ++k) cycle(kQuickStop);
  expect_all(kQuickStop);
  EXPECT_EQ(held(), before);
  EXPECT_EQ(drives[0].frames, 3);
}

TEST_F(StopTest, FullBus_TheNextFrameTriesAgain) {
  run(50);
  pass_time();
  bench.downstream.set_room(0);
  send(0, kQuickStop);
  EXPECT_EQ(drives[0].controlword, kOperation);
  EXPECT_EQ(bench.node().joint_counters().output_refused, 1U);
  bench.downstream.set_room(SIZE_MAX);
  send(0, kQuickStop);
  EXPECT_EQ(drives[0].controlword, kQuickStop);
}

TEST_F(StopTest, MappingThatEndsUnderACorrection_StopsPassAndTargetsDoNot) {
  for (const bool is_reset : {true, false}) {
    run(50);
    ASSERT_NE(held(), target) << "a correction";
    bench.nmt(is_reset ? 130 : 128);
    if (!is_reset) {
      bench.run_for(600'000);
      EXPECT_EQ(bench.write(0x1400, 1, 0x80000301, 4), 0U);
      EXPECT_EQ(bench.write(0x1404, 1, 0x80000305, 4), 0U);
    }
    const Joints before = held();
    cycle(kOperation);
    EXPECT_EQ(drives[0].frames, 0);
    for (int k = 0; k < 3; ++k) {
      cycle(kOperation);
      for (std::size_t axis = 0; axis < 6; ++axis) {
        send(axis, kHalt);
        EXPECT_EQ(drives[axis].controlword, kHalt) << axis;
        EXPECT_EQ(drives[axis].frames, k + 1) << "one that was lost is repeated";
      }
    }
    EXPECT_EQ(held(), before) << "the corrected targets, which another drive may follow";
    bench.run_for(600'000);
    for (unsigned axis = 0; axis < 6; ++axis) map(axis, {axis});
    bench.start_nodes();
  }
}

TEST_F(StopTest, ShortFrame_IsDropped) {
  run(50);
  pass_time();
  CanFrame brief = frame(0, kQuickStop);
  brief.len = 5;
  bench.from_controller(brief);
  take();
  EXPECT_EQ(drives[0].frames, 0) << "its drive would not take it either";
}

TEST_F(StopTest, ControlwordInASeparateRpdo_IsForwardedAndStored) {
  EXPECT_EQ(bench.write(0x1606, 0, 0, 1), 0U);
  EXPECT_EQ(bench.write(0x1606, 1, 0x60400010, 4), 0U);
  EXPECT_EQ(bench.write(0x1606, 0, 1, 1), 0U);
  EXPECT_EQ(bench.write(0x1406, 1, 0x310, 4), 0U);
  run(50);
  pass_time();
  send(0, kQuickStop);
  bench.from_controller(make_frame(0x310, {kOperation, 0}));
  EXPECT_EQ(bench.downstream.take_sent().size(), 1U);
  send(0, kQuickStop);
  EXPECT_EQ(drives[0].frames, 2) << "another than the drive was sent last";
}

TEST(StopForwarderTest, StopOfOneDriveInAFrame_ChangesNothingOfTheOther) {
  ObjectDictionary dictionary;
  dictionary.restore_defaults(0x20);
  dictionary.set(od::rpdo::kCOBID[0], 0x301U);
  dictionary.set(od::rpdo::kMappingCount[0], 4);
  auto entry = od::rpdo::kMapping[0];
  for (const std::uint32_t word : {0x60400010U, 0x607A0020U, 0x68400010U, 0x687A0020U}) {
    dictionary.set(entry, word);
    entry.offset = static_cast<std::uint16_t>(entry.offset + 4);
    ++entry.sub;
  }
  PdoTable pdos(dictionary, kFdPayload);
  pdos.refresh();
  const Pdo& pdo = pdos.rpdo(0);
  ASSERT_EQ(pdo.mapping.length, 12);
  const auto pair = [](int first, std::int32_t one, int second, std::int32_t other) {
    CanFrame frame;
    frame.flags = kFrameFd;
    frame.len = 12;
    store_le(&frame.data[0], static_cast<std::uint16_t>(first));
    store_le(&frame.data[2], one);
    store_le(&frame.data[6], static_cast<std::uint16_t>(second));
    store_le(&frame.data[8], other);
    return frame;
  };
  StopForwarder stops;
  EXPECT_FALSE(stops.commands_stop(pdo, pair(kOperation, 1, 0x1F, 2)));
  const CanFrame first = stops.stop_frame(pdo, pair(kQuickStop, 1, kOperation, 2));
  EXPECT_EQ(load_le<std::int32_t>(&first.data[8]), 2) << "its own: nothing was sent";
  stops.note_sent(pdo, pair(kOperation, 11, kSwitchOn, 22));
  EXPECT_FALSE(stops.is_new(pdo, pair(kOperation, 33, kSwitchOn, 44)));
  EXPECT_TRUE(stops.is_new(pdo, pair(kOperation, 11, kShutdown, 22)));
  const CanFrame stop = stops.stop_frame(pdo, pair(kQuickStop, 33, kOperation, 44));
  EXPECT_EQ(load_le<std::uint16_t>(&stop.data[0]), kQuickStop);
  EXPECT_EQ(load_le<std::int32_t>(&stop.data[2]), 11);
  EXPECT_EQ(load_le<std::uint16_t>(&stop.data[6]), kSwitchOn) << "enabling waits for a set";
  EXPECT_EQ(load_le<std::int32_t>(&stop.data[8]), 22);
  EXPECT_EQ(stop.len, 12);
}

// A judge of random streams: cycles of several lengths with and without SYNC, joints that rest and
// move, and one fault at a time (lost, late, doubled frame; lost or doubled SYNC; a pause; a stop).
// After every frame the drives hold the targets of one cycle, and a stop command has arrived.
class JudgedStreamTest : public StopTest {
 protected:
  enum Fault { kLost, kLate, kDoubled, kLostSync, kDoubledSync, kPause, kStop, kFaults };

  void take() override {
    StopTest::take();
    const bool has_moved = held() != judged;
    judged = held();
    if (has_moved && commanded.contains(moved)) {
      EXPECT_TRUE(commanded.contains(judged)) << "targets of two cycles at " << bench.now_us;
    }
    if (commanded.contains(judged)) moved = judged;
  }
  std::uint64_t below(std::uint64_t count) { return random() % count; }
  void wait_until(std::uint64_t us) {
    while (bench.now_us < us) {
      bench.now_us = std::min(us, bench.now_us + 50);
      bench.turn();
      take();
    }
  }
  void one_cycle(int fault) {
    const std::uint64_t begin_us = bench.now_us;
    const std::size_t victim = below(6);
    for (std::size_t axis = 0; axis < 6; ++axis) {
      if (below(40) == 0) rests[axis] = !rests[axis];
      if (!rests[axis]) target[axis] += 1000;
    }
    commanded.insert(target);
    if (has_sync && fault != kLostSync) bench.sync();
    if (has_sync && fault == kDoubledSync) bench.sync();
    take();
    const Joints before = target;
    for (std::size_t axis = 0; axis < 6; ++axis) {
      wait_until(begin_us + phase_us + axis * gap_us);
      if (axis == 0 && late) bench.from_controller(*std::exchange(late, std::nullopt));
      take();
      if (fault == kLate && axis == victim) late = frame(axis, kOperation);
      if ((fault == kLost || fault == kLate) && axis == victim) continue;
      send(axis, kOperation);
      if (fault == kDoubled && axis == victim) send(axis, kOperation);
    }
    wait_until(begin_us + phase_us + 6 * gap_us);
    if (fault == kStop) {
      send(victim, kQuickStop);
      EXPECT_EQ(drives[victim].controlword, kQuickStop);
    }
    target = before;
    wait_until(begin_us + period_us);
  }
  std::mt19937 random{1};
  std::set<Joints> commanded;
  Joints judged = {};
  Joints moved = {};
  std::array<bool, 6> rests = {};
  std::optional<CanFrame> late;
  std::uint64_t period_us = 1000;
  std::uint64_t gap_us = 20;
  std::uint64_t phase_us = 0;
};

class RandomStreamTest : public JudgedStreamTest, public testing::WithParamInterface<int> {
 protected:
  RandomStreamTest() { random.seed(static_cast<std::uint32_t>(GetParam())); }
  // Another cycle time, with or without an interruption.
  void restart() {
    wait_until(bench.now_us + (below(2) == 0 ? 100'000 : 3'000));
    // Without SYNC also shorter than the set window of 500 us.
    constexpr std::uint64_t kPeriods[] = {300, 400, 600, 1000, 2000, 3000, 4000};
    period_us = has_sync ? 1000 : kPeriods[below(std::size(kPeriods))];
    gap_us = 20 + below(std::max<std::uint64_t>(period_us / 8, 40) - 30);
    phase_us = has_sync && 6 * gap_us < 700 ? 100 + below(850 - 6 * gap_us) : 0;
    cycles = 0;
  }
  // Faults are few, so that none falls into the two cycles that another one spoils.
  int next_fault() {
    ++cycles;
    if (++undisturbed < 6 || below(8) != 0) return kFaults;
    undisturbed = 0;
    // Without SYNC, only a learnt window tells a repeated frame from one of the next cycle.
    const bool is_learnt = has_sync || cycles > 15;
    return static_cast<int>(below(is_learnt ? kFaults : kDoubled));
  }

  int cycles = 0;  // at this cycle time
  int undisturbed = 0;
};

TEST_P(RandomStreamTest, SingleFault_MixesNoCyclesAndHoldsBackNoStop) {
  bench.write(0x2000, 2, 0, 1);  // without a correction the drives' targets tell the cycle
  has_sync = GetParam() % 2 == 0;
  for (int k = 0; k < 3000 && !HasFailure(); ++k) {
    const int fault = next_fault();
    if (fault == kPause) restart();
    one_cycle(fault);
  }
  EXPECT_GT(bench.node().joint_counters().sets, 300U);
}

INSTANTIATE_TEST_SUITE_P(Seeds, RandomStreamTest, testing::Range(0, 12));

// The set window is longer than the cycle: no pause in the stream, however clear, would end a set.
TEST_F(JudgedStreamTest, CycleShorterThanTheSetWindow_OneLostFrameMixesNothing) {
  bench.write(0x2000, 2, 0, 1);
  has_sync = false;
  for (const std::uint64_t period : {240U, 300U, 400U, 450U}) {
    for (const std::uint64_t gap : {20U, 30U, 40U, 50U, 75U}) {
      if (6 * gap > period) continue;
      for (int lost = 0; lost < 12; ++lost) {
        SCOPED_TRACE(testing::Message() << period << " us, " << gap << " us, cycle " << lost);
        wait_until(bench.now_us + 100'000);
        std::tie(period_us, gap_us) = std::pair(period, gap);
        const std::uint32_t before = bench.node().joint_counters().sets;
        for (int k = 0; k < 40; ++k) one_cycle(k == lost ? kLost : kFaults);
        const bool has_clear_pause = 4 * (period - 5 * gap) > 5 * gap;
        const std::uint32_t sets = bench.node().joint_counters().sets - before;
        EXPECT_GE(sets, has_clear_pause ? 30U : 0U);
        ASSERT_FALSE(HasFailure());
      }
    }
  }
}

}  // namespace
}  // namespace armtrue::canopen
