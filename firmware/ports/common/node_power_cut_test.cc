// Cuts power at every flash operation of a table upload through the node's objects, while the arm
// stands. After the restart the drives get, cycle by cycle, the output of the old or of the new
// table, starting from the correction that the drives held throughout.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cstdio>
#include <cstdlib>
#include <utility>
#include <vector>

#include "firmware/testing/node_bench.h"
#include "firmware/testing/test_table.h"

namespace armtrue::canopen {
namespace {

using storage::CutKind;
using storage::PowerCut;
using Outputs = std::vector<std::array<std::int32_t, 6>>;

// Longer than the blending of either table, and in offset mode the 0.1 s that the arm must stand.
constexpr int cycles_of(Mode mode) { return mode == Mode::kInline ? 60 : 170; }

// Increments. The largest step is that of a 20 ms blend from one limit of the tables to the other.
constexpr std::int32_t kPermitted = 100;
constexpr std::int32_t kMagnitude = kPermitted << 12;
constexpr std::int32_t kLargestStep = 2 * kPermitted / 20 + 2;

std::vector<std::uint8_t> old_table() {
  return TestTable{.sequence = 1, .amplitude = 1 << 20, .magnitude = kMagnitude}.image();
}
std::vector<std::uint8_t> new_table() {
  return TestTable{.sequence = 2, .amplitude = -(1 << 21), .magnitude = kMagnitude}.image();
}

constexpr std::array<std::int32_t, 6> kPose = {230'000,  300'000, 150'000,
                                               -250'000, 270'000, -200'000};

void configure(NodeBench& bench, Mode mode) {
  bench.configure(mode);
  bench.downstream.take_sent();
  bench.upstream.take_sent();
}

// The corrections that the drives hold after each cycle (increments beyond their targets), starting
// with `held`. The arm stands at kPose.
Outputs outputs_of(NodeBench& bench, Mode mode, std::array<std::int32_t, 6> held) {
  configure(bench, mode);
  const bool offset = mode == Mode::kOffset;
  Outputs outputs;
  for (int cycle = 0; cycle < cycles_of(mode); ++cycle) {
    bench.next_sync();
    for (std::uint32_t pair = 0; pair < 3; ++pair) {
      const CanFrame frame = NodeBench::pair_frame(0x1C0 + pair, kPose[2 * pair] + held[2 * pair],
                                                   kPose[2 * pair + 1] + held[2 * pair + 1]);
      offset ? bench.from_controller(frame) : bench.from_drives(frame);
    }
    bench.command_joints(kPose);
    for (const CanFrame& frame : (offset ? bench.upstream : bench.downstream).take_sent()) {
      const std::uint32_t base = offset ? 0x1A0 : 0x220;
      if (frame.id != base && frame.id != base + 0x100 && frame.id != base + 0x200) continue;
      const std::size_t first = 2 * ((frame.id - base) / 0x100);
      for (std::size_t k = first; k < first + 2; ++k) {
        held[k] = load_le<std::int32_t>(&frame.data[4 * (k - first)]) - (offset ? 0 : kPose[k]);
      }
    }
    outputs.push_back(held);
  }
  return outputs;
}

std::int32_t largest_step(std::array<std::int32_t, 6> held, const Outputs& outputs) {
  std::int32_t most = 0;
  for (const auto& next : outputs) {
    for (std::size_t k = 0; k < 6; ++k) most = std::max(most, std::abs(next[k] - held[k]));
    held = next;
  }
  return most;
}

using Tables = std::vector<std::vector<std::uint8_t>>;

// The corrections that the drives hold after these tables were installed and blending has ended.
std::array<std::int32_t, 6> held_with(const Tables& tables, Mode mode) {
  NodeBench bench(mode == Mode::kInline);
  for (const auto& table : tables) bench.install(table);
  return outputs_of(bench, mode, {}).back();
}

Outputs reference(const Tables& tables, Mode mode, const std::array<std::int32_t, 6>& held) {
  NodeBench bench(mode == Mode::kInline);
  for (const auto& table : tables) bench.install(table);
  bench.power_on();
  return outputs_of(bench, mode, held);
}

std::size_t operations_of_an_upload(const Tables& before) {
  NodeBench bench;
  for (const auto& table : before) bench.install(table);
  bench.flash.run_undisturbed();
  bench.install(new_table());
  return bench.flash.operations();
}

// The tables that were installed before the upload.
struct History {
  const char* name;
  Tables before;
};
const std::vector<History> kHistories = {
    {"blank", {}},
    {"one table", {old_table()}},
    {"two tables",
     {TestTable{.sequence = 0, .amplitude = 1 << 19, .magnitude = kMagnitude}.image(),
      old_table()}},
};

std::vector<std::pair<Mode, History>> campaigns() {
  std::vector<std::pair<Mode, History>> all;
  for (const Mode mode : {Mode::kInline, Mode::kOffset}) {
    for (const History& history : kHistories) all.emplace_back(mode, history);
  }
  return all;
}

TEST(NodePowerCut, TheDrivesGetTheOldTableOrTheNewOne) {
  std::size_t cases = 0;
  std::size_t new_ones = 0;
  for (const auto& [mode, history] : campaigns()) {
    Tables after = history.before;
    after.push_back(new_table());
    const auto held = held_with(history.before, mode);
    const Outputs with_old = reference(history.before, mode, held);
    const Outputs with_new = reference(after, mode, held);
    ASSERT_NE(with_old, with_new);
    ASSERT_LE(largest_step(held, with_old), history.before.empty() ? 0 : 1) << "as it was";
    ASSERT_LE(largest_step(held, with_new), kLargestStep);
    const std::size_t operations = operations_of_an_upload(history.before);
    for (std::size_t at = 0; at < operations; ++at) {
      for (const CutKind kind : storage::kAllCutKinds) {
        NodeBench bench(mode == Mode::kInline);
        for (const auto& table : history.before) bench.install(table);
        bench.flash.cut_at(at, kind);
        EXPECT_THROW(bench.install(new_table()), PowerCut);
        bench.flash.run_undisturbed();
        bench.power_on();
        const Outputs outputs = outputs_of(bench, mode, held);
        ASSERT_TRUE(outputs == with_old || outputs == with_new)
            << int(mode) << history.name << ", operation " << at << ", kind " << int(kind);
        if (outputs == with_new) ++new_ones;
        ++cases;
      }
    }
  }
  std::printf("[ COUNT    ] power cuts of an upload through the node: %zu, new table after %zu\n",
              cases, new_ones);
  EXPECT_GT(cases, 7000U);
  EXPECT_GT(new_ones, 0U) << "the confirmation is among what is cut";
  EXPECT_LT(new_ones, 120U) << "and nothing before it brings the new table";
}

// A word is not programmed or a slot not erased: the client's request fails, the error is reported
// in 0x1003, and the drives continue with the table that was in force.
TEST(NodePowerCut, FailedOperation_IsReportedAndKeepsTheOldTable) {
  std::size_t cases = 0;
  std::size_t refused = 0;
  for (const auto& [mode, history] : campaigns()) {
    Tables after = history.before;
    after.push_back(new_table());
    const auto held = held_with(history.before, mode);
    const Outputs with_old = reference(history.before, mode, held);
    const Outputs with_new = reference(after, mode, held);
    const std::size_t operations = operations_of_an_upload(history.before);
    for (std::size_t at = 0; at < operations; ++at) {
      NodeBench bench(mode == Mode::kInline);
      for (const auto& table : history.before) bench.install(table);
      bench.flash.fail_at(at);
      bool was_refused = false;
      try {
        bench.install(new_table());
      } catch (const std::runtime_error&) {
        was_refused = true;
      }
      if (was_refused) {
        ASSERT_EQ(bench.read(0x1003, 1) & 0xFFFFU, 0x5530U)
            << int(mode) << history.name << ", operation " << at;
        ++refused;
      }
      bench.flash.run_undisturbed();
      bench.power_on();
      ASSERT_EQ(outputs_of(bench, mode, held), was_refused ? with_old : with_new)
          << int(mode) << history.name << ", operation " << at;
      ++cases;
    }
  }
  std::printf("[ COUNT    ] failed operations of an upload: %zu, refused %zu, else written again\n",
              cases, refused);
  EXPECT_GT(refused, cases / 2);
}

}  // namespace
}  // namespace armtrue::canopen
