#include "firmware/ports/r5f/gic.h"

#include <gtest/gtest.h>

#include <map>
#include <vector>

namespace armtrue::r5f {
namespace {

class FakeRegisters {
 public:
  std::uint32_t read(std::uint32_t offset) const {
    if (on_read.contains(offset) && !on_read.at(offset).empty()) {
      const std::uint32_t value = on_read.at(offset).front();
      on_read.at(offset).erase(on_read.at(offset).begin());
      return value;
    }
    return values.contains(offset) ? values.at(offset) : 0;
  }
  void write(std::uint32_t offset, std::uint32_t value) {
    values[offset] = value;
    written.emplace_back(offset, value);
  }

  mutable std::map<std::uint32_t, std::vector<std::uint32_t>> on_read;
  std::map<std::uint32_t, std::uint32_t> values;
  std::vector<std::pair<std::uint32_t, std::uint32_t>> written;
};

class GicTest : public testing::Test {
 protected:
  FakeRegisters distributor_;
  FakeRegisters interface_;
  Gic<FakeRegisters> gic_{distributor_, interface_};
};

TEST_F(GicTest, IsAbsentIfItsTypeRegisterReadsZero) {
  EXPECT_FALSE(gic_.is_present());
  distributor_.values[gic::kType] = 5;
  EXPECT_TRUE(gic_.is_present());
}

TEST_F(GicTest, Start_DisablesEveryImplementedInterrupt) {
  distributor_.values[gic::kType] = 5;  // six lines of 32
  gic_.start();
  for (std::uint32_t line = 0; line < 6; ++line) {
    EXPECT_EQ(distributor_.values.at(gic::kClearEnable + 4 * line), 0xFFFFFFFFU);
  }
  EXPECT_FALSE(distributor_.values.contains(gic::kClearEnable + 4 * 6));
  EXPECT_EQ(distributor_.values.at(gic::kDistributorControl), 1U);
  EXPECT_EQ(interface_.values.at(gic::kPriorityMask), 0xFFU);
  EXPECT_EQ(interface_.values.at(gic::kInterfaceControl), 1U);
}

TEST_F(GicTest, EnableTouchesOnlyItsOwnInterrupt) {
  distributor_.values[gic::kTargets + 52] = 0x11223344;
  distributor_.values[gic::kPriority + 52] = 0x55667788;
  gic_.enable(55);
  EXPECT_EQ(distributor_.values.at(gic::kTargets + 52), 0x01223344U);
  EXPECT_EQ(distributor_.values.at(gic::kPriority + 52), 0xA0667788U);
  EXPECT_EQ(distributor_.values.at(gic::kSetEnable + 4), 1U << 23);
}

TEST_F(GicTest, ServesEachPendingInterruptOnceAndEndsIt) {
  interface_.on_read[gic::kAcknowledge] = {55, 56 | 1U << 10, 1023};
  std::vector<std::uint32_t> served;
  gic_.serve([&](std::uint32_t number) { served.push_back(number); });
  EXPECT_EQ(served, (std::vector<std::uint32_t>{55, 56}));
  ASSERT_EQ(interface_.written.size(), 2U);
  EXPECT_EQ(interface_.written[1],
            (std::pair<std::uint32_t, std::uint32_t>{gic::kEndOfInterrupt, 56 | 1U << 10}))
      << "with the source processor that was acknowledged";
}

TEST_F(GicTest, SpuriousInterrupt_IsNotServed) {
  interface_.on_read[gic::kAcknowledge] = {1023};
  gic_.serve([](std::uint32_t number) { ADD_FAILURE() << number; });
  EXPECT_TRUE(interface_.written.empty());
}

}  // namespace
}  // namespace armtrue::r5f
