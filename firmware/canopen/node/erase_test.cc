// Flash is erased only while the drives are disabled: an erase stops forwarding for seconds.
#include <gtest/gtest.h>

#include "firmware/testing/node_bench.h"
#include "firmware/testing/test_table.h"

namespace armtrue::canopen {
namespace {

constexpr std::size_t kJoints = 6;

class EraseTest : public testing::Test {
 protected:
  EraseTest() {
    for (std::uint16_t k = 0; k < kJoints; ++k) {
      const auto parameter = static_cast<std::uint16_t>(0x1408 + k);
      const auto mapping = static_cast<std::uint16_t>(0x1608 + k);
      expect_done(parameter, 1, 0x800001D0U + k, 4);
      expect_done(mapping, 0, 0, 1);
      expect_done(mapping, 1, (0x6041U + 0x800U * k) << 16 | 16, 4);
      expect_done(mapping, 0, 1, 1);
      expect_done(parameter, 1, 0x1D0U + k, 4);
    }
    const std::vector<std::uint8_t> image = TestTable{}.image();
    EXPECT_EQ(bench.stage(image), 0U);
    EXPECT_EQ(bench.command(TableCommand::kVerify), 0U);
  }

  void expect_done(std::uint16_t index, std::uint8_t sub, std::uint32_t value, int size) {
    EXPECT_EQ(bench.write(index, sub, value, size), 0U);
  }
  void drive_says(std::size_t k, int statusword) {
    bench.from_drives(
        make_frame(0x1D0 + static_cast<std::uint32_t>(k), {statusword & 0xFF, statusword >> 8}));
  }
  void all_drives_say(int statusword) {
    for (std::size_t k = 0; k < kJoints; ++k) drive_says(k, statusword);
  }
  // Commit, save and restore are all refused, and flash is as it was.
  void expect_refused() {
    const std::size_t erases = bench.flash.erases();
    EXPECT_EQ(bench.command(TableCommand::kCommit), kDeviceState);
    EXPECT_EQ(bench.write(0x1010, 1, kSave, 4), kDeviceState);
    EXPECT_EQ(bench.write(0x1011, 1, kLoad, 4), kDeviceState);
    EXPECT_EQ(bench.flash.erases(), erases);
  }
  void expect_allowed() {
    expect_done(0x1010, 1, kSave, 4);
    expect_done(0x1011, 1, kLoad, 4);
    EXPECT_EQ(bench.command(TableCommand::kCommit), 0U);
  }

  NodeBench bench;
};

TEST_F(EraseTest, NoDriveOnTheBus_IsAllowed) { expect_allowed(); }

TEST_F(EraseTest, AllDrivesDisabled_IsAllowed) {
  all_drives_say(kOperationEnabled);
  expect_refused();
  all_drives_say(kSwitchOnDisabled);
  expect_allowed();
}

TEST_F(EraseTest, OneDriveEnabled_IsRefused) {
  for (std::size_t k = 0; k < kJoints; ++k) {
    all_drives_say(kSwitchOnDisabled);
    drive_says(k, kOperationEnabled);
    expect_refused();
  }
}

TEST_F(EraseTest, EnabledDriveFallsSilent_IsRefused) {
  all_drives_say(kOperationEnabled);
  bench.run_for(10'000'000, 10'000);
  expect_refused();
}

TEST_F(EraseTest, DriveThatSendsNoStatusword_IsRefused) {
  for (std::size_t k = 0; k + 1 < kJoints; ++k) drive_says(k, kSwitchOnDisabled);
  bench.from_drives(make_frame(0x706, {5}));
  expect_refused();
  bench.run_for(2'000'000, 10'000);
  expect_allowed();
}

// In offset mode the drives are on the bus of the controller.
TEST(EraseWithOneBus, DriveThatSendsPositionsAlone_IsRefused) {
  NodeBench bench(false);
  bench.configure(Mode::kOffset);
  bench.from_controller(NodeBench::pair_frame(0x1C0, 0, 0));
  EXPECT_EQ(bench.write(0x1010, 1, kSave, 4), kDeviceState);
  bench.run_for(1'001'000);
  EXPECT_EQ(bench.write(0x1010, 1, kSave, 4), 0U);
}

// Frames that come while the core stalls are lost; their sender was not silent.
TEST_F(EraseTest, LongErase_IsNotCountedAsALostHeartbeat) {
  constexpr std::uint32_t kHeartbeatTimeMs = 1000;
  constexpr std::uint64_t kStallUs = 2'000'000;
  expect_done(0x1016, 1, 5U << 16 | kHeartbeatTimeMs, 4);
  bench.from_controller(make_frame(0x705, {5}));
  bench.run_for(900'000);
  bench.parameters.meanwhile = [this] {
    bench.now_us += kStallUs;
    NodeBench::clock_now_us += kStallUs;
  };
  expect_done(0x1010, 1, kSave, 4);
  bench.run_for(99'000);
  EXPECT_EQ(bench.read(0x1001, 0), 0U);
  bench.run_for(1'000);
  EXPECT_NE(bench.read(0x1001, 0), 0U) << "what was left of its time was not forgotten";
}

TEST(EraseAtStart, SpareSlotTorn_IsNotErased) {
  NodeBench bench;
  bench.install(TestTable{}.image());
  bench.flash.word(1, storage::kBegunAt) = 0;
  const std::size_t erases = bench.flash.erases();
  bench.power_on();
  EXPECT_EQ(bench.flash.erases(), erases);
}

TEST(TableDamagedInFlash, IsReportedAtTheStart) {
  NodeBench bench;
  bench.install(TestTable{}.image());
  const std::size_t slot = *bench.store().status().active;
  bench.upstream.take_sent();
  bench.power_on();
  EXPECT_EQ(bench.read(0x1001, 0), 0U);
  bench.flash.word(slot, storage::kHeaderWords + 20) ^= 1U;
  bench.power_on();
  bench.run_for(10'000);
  EXPECT_NE(bench.read(0x1001, 0), 0U);
  EXPECT_EQ(bench.read(0x1003, 1) & 0xFFFFU, 0x5530U);
}

}  // namespace
}  // namespace armtrue::canopen
