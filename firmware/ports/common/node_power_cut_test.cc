// Power is cut at every flash operation while a table is uploaded through the node's own objects;
// what reaches the drives after the restart is, cycle by cycle, what the old or the new table
// gives.
#include <gtest/gtest.h>

#include <array>
#include <cstdio>
#include <vector>

#include "firmware/canopen/node_bench.h"
#include "firmware/canopen/test_table.h"

namespace armtrue::canopen {
namespace {

using storage::CutKind;
using storage::PowerCut;
using Outputs = std::vector<std::array<std::int32_t, 6>>;

constexpr int kCycles = 60;  // beyond the blending of either table

std::vector<std::uint8_t> old_table() {
  return TestTable{.sequence = 1, .amplitude = 1 << 20}.image();
}
std::vector<std::uint8_t> new_table() {
  return TestTable{.sequence = 2, .amplitude = -(1 << 21)}.image();
}

// What the drives are told in the first cycles after power-on.
Outputs outputs_of(NodeBench& bench) {
  bench.configure(Mode::kInline);
  bench.downstream.take_sent();
  Outputs outputs;
  for (int cycle = 0; cycle < kCycles; ++cycle) {
    bench.now_us += 1000;
    bench.from_controller(make_frame(0x80, {}));
    bench.command_joints({100'000 + 20 * cycle, 200'000, 300'000, -100'000, 50'000, 7 * cycle});
    std::array<std::int32_t, 6> corrected = {};
    for (const CanFrame& frame : bench.downstream.take_sent()) {
      if (frame.id != 0x220 && frame.id != 0x320 && frame.id != 0x420) continue;
      const std::size_t first = 2 * (frame.id / 0x100 - 2);
      corrected[first] = load_le<std::int32_t>(&frame.data[0]);
      corrected[first + 1] = load_le<std::int32_t>(&frame.data[4]);
    }
    outputs.push_back(corrected);
  }
  return outputs;
}

Outputs reference(const std::vector<std::vector<std::uint8_t>>& tables) {
  NodeBench bench;
  for (const auto& table : tables) bench.install(table);
  bench.power_on();
  return outputs_of(bench);
}

using Tables = std::vector<std::vector<std::uint8_t>>;

std::size_t operations_of_an_upload(const Tables& before) {
  NodeBench bench;
  for (const auto& table : before) bench.install(table);
  bench.flash.run_undisturbed();
  bench.install(new_table());
  return bench.flash.operations();
}

// The tables that were there, and what the drives get with and without the new one.
struct History {
  const char* name;
  Tables before;
};
const std::vector<History> kHistories = {
    {"blank", {}},
    {"one table", {old_table()}},
    {"two tables", {TestTable{.sequence = 0, .amplitude = 1 << 19}.image(), old_table()}},
};

TEST(NodePowerCut, TheDrivesGetTheOldTableOrTheNewOne) {
  std::size_t cases = 0;
  std::size_t new_ones = 0;
  for (const History& history : kHistories) {
    Tables after = history.before;
    after.push_back(new_table());
    const Outputs with_old = reference(history.before);
    const Outputs with_new = reference(after);
    ASSERT_NE(with_old, with_new);
    const std::size_t operations = operations_of_an_upload(history.before);
    for (std::size_t at = 0; at < operations; ++at) {
      for (const CutKind kind : storage::kAllCutKinds) {
        NodeBench bench;
        for (const auto& table : history.before) bench.install(table);
        bench.flash.cut_at(at, kind);
        EXPECT_THROW(bench.install(new_table()), PowerCut);
        bench.flash.run_undisturbed();
        bench.power_on();
        const Outputs outputs = outputs_of(bench);
        ASSERT_TRUE(outputs == with_old || outputs == with_new)
            << history.name << ", operation " << at << ", kind " << int(kind);
        if (outputs == with_new) ++new_ones;
        ++cases;
      }
    }
  }
  std::printf("[ COUNT    ] power cuts of an upload through the node: %zu, new table after %zu\n",
              cases, new_ones);
  EXPECT_GT(cases, 3000U);
  EXPECT_GT(new_ones, 0U) << "the confirmation is among what is cut";
  EXPECT_LT(new_ones, 60U) << "and nothing before it brings the new table";
}

// A word that does not take, an erase that does not erase: said to the client, reported on the bus,
// and the drives go on with the table that was in force.
TEST(NodePowerCut, AFailedOperationIsRefusedReportedAndChangesNothing) {
  std::size_t cases = 0;
  std::size_t refused = 0;
  for (const History& history : kHistories) {
    Tables after = history.before;
    after.push_back(new_table());
    const Outputs with_old = reference(history.before);
    const Outputs with_new = reference(after);
    const std::size_t operations = operations_of_an_upload(history.before);
    for (std::size_t at = 0; at < operations; ++at) {
      NodeBench bench;
      for (const auto& table : history.before) bench.install(table);
      bench.flash.fail_at(at);
      bool was_refused = false;
      try {
        bench.install(new_table());
      } catch (const std::runtime_error&) {
        was_refused = true;
      }
      if (was_refused) {
        ASSERT_EQ(bench.read(0x1003, 1) & 0xFFFFU, 0x5530U) << history.name << ", operation " << at;
        ++refused;
      }
      bench.flash.run_undisturbed();
      bench.power_on();
      ASSERT_EQ(outputs_of(bench), was_refused ? with_old : with_new)
          << history.name << ", operation " << at;
      ++cases;
    }
  }
  std::printf("[ COUNT    ] failed operations of an upload: %zu, refused %zu, else written again\n",
              cases, refused);
  EXPECT_GT(refused, cases / 2);
}

}  // namespace
}  // namespace armtrue::canopen
