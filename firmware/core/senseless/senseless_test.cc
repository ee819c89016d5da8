// A few hundred random tables that are well formed but mean nothing; senseless_main.cc runs 10 000.
#include <gtest/gtest.h>

#include "firmware/core/senseless/senseless_run.h"
#include "firmware/core/table/table.h"
#include "firmware/core/table/table_cost.h"

namespace armtrue {
namespace {

TEST(SenselessTableTest, RandomTable_StaysWithinTheMaxima) {
  int taken = 0;
  tests::Bytes outputs;
  for (std::uint64_t seed = 0; seed < 400; ++seed) {
    const tests::SenselessRun run = tests::run_senseless(seed);
    EXPECT_EQ(run.wrong, "") << "seed " << seed;
    taken += run.accepted ? 1 : 0;
    outputs.insert(outputs.end(), run.outputs.begin(), run.outputs.end());
  }
  // Changes only with a decision, as the checksums of reference_test.cc (latest: 0080).
  EXPECT_EQ(crc32(outputs), 0x7F2D36A9U) << std::hex << crc32(outputs);
  // If all tables were refused, nothing would be tested; if none were, no limit would be reached.
  EXPECT_GT(taken, 200);
  EXPECT_LT(taken, 380);
}

TEST(SenselessTableTest, RandomTables_ReachSeveralRefusals) {
  std::array<int, 32> seen = {};
  tests::Bytes verdicts;
  for (std::uint64_t seed = 0; seed < 2000; ++seed) {
    const tests::Bytes image = tests::SenselessImage(seed).image();
    const Validation validation = validate(image, {});
    ++seen[static_cast<std::size_t>(validation.refusal)];
    verdicts.push_back(static_cast<std::uint8_t>(validation.refusal));
    tests::append(verdicts, static_cast<std::uint32_t>(validation.field));
    if (validation.accepted()) tests::append(verdicts, cycle_cost(image));
  }
  // Refusals, fields and costs are reported to users and tools: they change only with a decision.
  EXPECT_EQ(crc32(verdicts), 0x6FC846E1U) << std::hex << crc32(verdicts);
  for (const Refusal refusal :
       {Refusal::kNone, Refusal::kBadReference, Refusal::kValueRange, Refusal::kTooCostly}) {
    EXPECT_GT(seen[static_cast<std::size_t>(refusal)], 10) << name_of(refusal);
  }
}

}  // namespace
}  // namespace armtrue
