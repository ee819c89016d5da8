// Ideal drives behind a node, for tests: they follow the targets or offsets that it sends, and keep
// a position offset until they get another.
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>
#include <string>
#include <utility>
#include <vector>

#include "firmware/testing/node_bench.h"
#include "firmware/testing/test_table.h"

namespace armtrue::canopen {

using Joints = std::array<std::int32_t, 6>;

inline constexpr std::uint32_t kSetsWithheld = 0xFF15;  // emergency code
inline constexpr std::uint32_t kUnknownBit = 1U << 4;   // of 0x2001 sub 2
inline constexpr std::int32_t kPermitted = 400;  // increments: the table's largest correction
// Step per cycle of a 20 ms blend from one limit of the table to the other.
inline constexpr std::int32_t kBlendStep = 2 * kPermitted / 20 + 2;

// The test table's largest corrections, where no joint is close to the top of its sine.
inline constexpr Joints kStand = {230'000, 300'000, 150'000, -250'000, 270'000, -200'000};

inline Joints moved(const Joints& joints, std::int32_t by) {
  Joints result = joints;
  for (std::int32_t& joint : result) joint += by;
  return result;
}

inline std::int32_t farthest(const Joints& one, const Joints& other) {
  std::int32_t most = 0;
  for (std::size_t k = 0; k < one.size(); ++k) most = std::max(most, std::abs(one[k] - other[k]));
  return most;
}

// Instance names of a suite that runs in both modes.
inline std::string mode_name(const ::testing::TestParamInfo<Mode>& mode) {
  return mode.param == Mode::kInline ? "Inline" : "Offset";
}

class DrivesTest : public ::testing::TestWithParam<Mode> {
 protected:
  // Increments in a cycle, a little more than 0.1 turn per second.
  static constexpr std::int32_t kRate = 106;

  DrivesTest() : offset_(GetParam() == Mode::kOffset), bench(!offset_) {
    bench.install(TestTable{.magnitude = kPermitted << 12}.image());
    bench.configure(GetParam());
    EXPECT_EQ(bench.write(0x1010, 1, kSave, 4), 0U);
    take_output();
  }

  void nmt(int command) { bench.nmt(command); }
  NmtState state() { return bench.node().nmt_state(); }

  // Lets time pass without frames. Returns the largest step of a drive in a turn of the loop.
  std::int32_t wait(int milliseconds) {
    std::int32_t most = 0;
    take_output();
    for (std::uint64_t left_us = 1000 * static_cast<std::uint64_t>(milliseconds); left_us > 0;
         left_us -= turn_us) {
      const Joints before = stand;
      bench.now_us += turn_us;
      bench.turn();
      take_output();
      most = std::max(most, farthest(before, stand));
    }
    return most;
  }

  // The drives take the output of the node, targets or offsets.
  void take_output() {
    outputs = 0;
    auto& port = offset_ ? bench.upstream : bench.downstream;
    std::vector<CanFrame> frames = std::exchange(bench.aside, {});  // sent while SDO was waited for
    for (const CanFrame& frame : port.take_sent()) frames.push_back(frame);
    for (const CanFrame& frame : frames) {
      const std::uint32_t base = offset_ ? 0x1A0 : 0x220;
      if (frame.id == 0x700U + NodeBench::kNodeId) states.push_back(frame.data[0]);
      if (frame.is(kFrameExtended) || frame.len != 8) continue;
      if (frame.id != base && frame.id != base + 0x100 && frame.id != base + 0x200) continue;
      const std::size_t first = 2 * ((frame.id - base) / 0x100);
      for (std::size_t k = 0; k < 2; ++k) {
        (offset_ ? held : stand)[first + k] = load_le<std::int32_t>(&frame.data[4 * k]);
      }
      ++outputs;
    }
    if (offset_) {
      for (std::size_t k = 0; k < 6; ++k) stand[k] = target[k] + held[k];
    }
  }

  // SYNC, actual positions, new targets. The controller reads its actual positions from `seen`.
  void cycle(const Joints& joints) {
    bench.next_sync();
    take_output();
    feed_back();
    target = joints;
    const std::int32_t before = outputs;
    bench.command_joints(joints);
    take_output();
    outputs += before;
  }

  // RPDO 15 receives the offset that the drive of joint 1 reports.
  void map_offset_of_joint_1() {
    ASSERT_EQ(bench.write(0x160E, 0, 0, 1), 0U);
    ASSERT_EQ(bench.write(0x160E, 1, 0x20070120, 4), 0U);
    ASSERT_EQ(bench.write(0x160E, 0, 1, 1), 0U);
    ASSERT_EQ(bench.write(0x140E, 1, 0x1E0, 4), 0U);
  }
  void drive_has(std::int32_t offset) {
    CanFrame frame = make_frame(0x1E0, {0, 0, 0, 0});
    store_le(&frame.data[0], offset);
    bench.from_controller(frame);
  }

  void feed_back() {
    for (std::uint32_t pair = 0; pair < 3; ++pair) {
      Joints actual = {};
      for (std::size_t k = 0; k < 6; ++k) actual[k] = stand[k] - following_error;
      const CanFrame frame =
          NodeBench::pair_frame(0x1C0 + pair, actual[2 * pair], actual[2 * pair + 1]);
      if (offset_) {
        bench.from_controller(frame);
        continue;
      }
      bench.from_drives(frame);
      for (const CanFrame& back : bench.upstream.take_sent()) {
        if (back.id != frame.id) continue;
        seen[2 * pair] = load_le<std::int32_t>(&back.data[0]);
        seen[2 * pair + 1] = load_le<std::int32_t>(&back.data[4]);
      }
    }
    if (!offset_ || bench.node().nmt_state() == NmtState::kStopped) return;
    for (std::uint16_t k = 0; k < 6; ++k) {
      seen[k] =
          static_cast<std::int32_t>(bench.read(static_cast<std::uint16_t>(0x6064 + 0x800 * k), 0));
    }
  }

  // Runs cycles with constant targets. Returns the largest step of a drive.
  std::int32_t rest(const Joints& joints, int cycles) {
    std::int32_t most = 0;
    for (int k = 0; k < cycles; ++k) {
      const Joints before = stand;
      cycle(joints);
      most = std::max(most, farthest(before, stand));
    }
    return most;
  }

  // Runs cycles with all targets at kStand. From the first output on, the controller must read its
  // own command as the actual position; it may differ by what the correction changes in the `late`
  // cycles that feedback takes.
  void expect_uncorrected_from_the_first_set(int cycles, int late) {
    bool begun = false;
    for (int k = 0; k < cycles; ++k) {
      cycle(kStand);
      if (begun) {
        EXPECT_LE(farthest(seen, kStand), late * kBlendStep) << k;
      }
      begun = begun || outputs > 0;
    }
    EXPECT_TRUE(begun);
  }

  // Arm at kStand, correction settled.
  void settle() {
    target = stand = kStand;
    rest(kStand, 200);
    ASSERT_GT(farthest(stand, kStand), 150);
    ASSERT_EQ(seen, kStand);
  }

  void restart() {
    bench.power_on();
    bench.start_nodes();
    take_output();
  }

  std::uint32_t status() { return bench.read(0x2001, 2); }

  bool offset_;
  NodeBench bench;
  Joints target = {};
  Joints stand = {};
  Joints held = {};  // position offsets
  Joints seen = {};
  std::int32_t following_error = 0;
  std::uint64_t turn_us = 1000;
  std::int32_t outputs = 0;  // frames in the last cycle
  std::vector<int> states;   // heartbeats and boot-ups, in order
};

}  // namespace armtrue::canopen
