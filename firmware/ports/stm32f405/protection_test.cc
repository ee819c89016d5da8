// Watchdogs, supply, clock security, memory protection and guarded flash against fake registers.
#include <gtest/gtest.h>

#include <array>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "firmware/ports/arm/mpu.h"
#include "firmware/ports/stm32f405/guarded_flash.h"
#include "firmware/ports/stm32f405/supply.h"
#include "firmware/ports/stm32f405/watchdogs.h"
#include "firmware/storage/ram_flash.h"

namespace armtrue::stm32f405 {
namespace {

using ports::ResetCause;

// Registers that keep the written values and the order of the writes.
class FakeRegisters {
 public:
  std::uint32_t read(std::uint32_t offset) const {
    const auto found = value.find(offset);
    return found == value.end() ? 0 : found->second;
  }
  void write(std::uint32_t offset, std::uint32_t word) {
    value[offset] = word;
    written.emplace_back(offset, word);
  }

  std::map<std::uint32_t, std::uint32_t> value;
  std::vector<std::pair<std::uint32_t, std::uint32_t>> written;
};

TEST(IndependentWatchdog, SetTimeout_StartsUnlocksAndFeeds) {
  FakeRegisters registers;
  IndependentWatchdog watchdog(registers);
  watchdog.set_timeout(1000);
  const std::vector<std::pair<std::uint32_t, std::uint32_t>> expected = {
      {0x00, 0xCCCC}, {0x00, 0x5555}, {0x04, 6}, {0x08, 125}, {0x00, 0xAAAA}};
  EXPECT_EQ(registers.written, expected);
}

class WindowWatchdogTest : public testing::Test {
 protected:
  static constexpr std::uint32_t kFed = 0xFF;
  std::size_t feedings() const {
    std::size_t count = 0;
    for (const auto& [offset, word] : registers.written) count += offset == 0 && word == kFed;
    return count;
  }

  FakeRegisters registers;
  FakeRegisters rcc;
  WindowWatchdog<FakeRegisters, FakeRegisters> watchdog{registers, rcc};
};

TEST_F(WindowWatchdogTest, Feed_InAFastLoop_StaysWithinTheWindow) {
  watchdog.feed(0);
  EXPECT_EQ(feedings(), 0U) << "it does not run yet";
  watchdog.start(1000);
  EXPECT_EQ(registers.read(0x04), (3U << 7) | 0x6FU);
  std::uint64_t fed_us = 1000;
  for (std::uint64_t now_us = 1000; now_us < 1'000'000; now_us += 137) {
    const std::size_t before = feedings();
    watchdog.feed(now_us);
    if (feedings() == before) continue;
    EXPECT_GE(now_us - fed_us, 12'500U);  // 16 steps of 0.78 ms
    EXPECT_LE(now_us - fed_us, 49'900U);  // 64 steps
    fed_us = now_us;
  }
  EXPECT_GE(feedings(), 38U);
}

TEST_F(WindowWatchdogTest, PausedTime_DoesNotCountInTheWindow) {
  watchdog.start(0);
  watchdog.pause(5'000);
  EXPECT_EQ(rcc.read(0x40) & 1U << 11, 0U);
  watchdog.resume(2'005'000);
  EXPECT_NE(rcc.read(0x40) & 1U << 11, 0U);
  watchdog.feed(2'006'000);
  EXPECT_EQ(feedings(), 1U) << "the start's: six milliseconds of its own would be too early";
  watchdog.feed(2'025'000);
  EXPECT_EQ(feedings(), 2U);
}

TEST(ResetCauseOfTheChip, EveryFlag_HasItsCauseAndIsCleared) {
  const std::vector<std::pair<std::uint32_t, ResetCause>> cases = {
      {0x0E000000, ResetCause::kPowerOn},  // power on, with the flags of pin and brown-out
      {0x06000000, ResetCause::kBrownOut},       {0x04000000, ResetCause::kPin},
      {0x14000000, ResetCause::kSoftware},       {0x24000000, ResetCause::kWatchdog},
      {0x44000000, ResetCause::kWindowWatchdog}, {0x84000000, ResetCause::kLowPower},
      {0x00000000, ResetCause::kUnknown}};
  for (const auto& [flags, cause] : cases) {
    FakeRegisters rcc;
    rcc.value[0x74] = flags;
    EXPECT_EQ(take_reset_cause(rcc), cause) << std::hex << flags;
    EXPECT_NE(rcc.read(0x74) & 1U << 24, 0U);
  }
}

TEST(VoltageDetector, Start_WatchesForBelow2V9) {
  FakeRegisters pwr;
  FakeRegisters exti;
  pwr.value[0x00] = 1U << 14;
  VoltageDetector detector(pwr, exti);
  detector.start();
  EXPECT_EQ(pwr.read(0x00), (1U << 14) | (7U << 5) | (1U << 4));
  EXPECT_EQ(exti.read(0x08), 1U << 16);
  EXPECT_EQ(exti.read(0x00), 1U << 16);
  EXPECT_FALSE(detector.is_low());
  pwr.value[0x04] = 1U << 2;
  EXPECT_TRUE(detector.is_low());
}

TEST(VoltageDetector, Interrupt_IsCountedAndCleared) {
  FakeRegisters pwr;
  FakeRegisters exti;
  VoltageDetector detector(pwr, exti);
  detector.on_interrupt();
  detector.on_interrupt();
  EXPECT_EQ(detector.dips(), 2U);
  EXPECT_EQ(exti.written.back(), (std::pair<std::uint32_t, std::uint32_t>{0x14, 1U << 16}));
}

TEST(ClockSecurity, Failure_IsSeenOnceAndCleared) {
  FakeRegisters rcc;
  start_clock_security(rcc);
  EXPECT_EQ(rcc.read(0x00), 1U << 19);
  EXPECT_FALSE(take_clock_failure(rcc)) << "another NMI";
  rcc.value[0x0C] = 1U << 7;
  EXPECT_TRUE(take_clock_failure(rcc));
  EXPECT_NE(rcc.read(0x0C) & 1U << 23, 0U);
}

TEST(OptionBytes, FactoryValue_ProtectsNothing_RequiredValueAll) {
  FakeRegisters flash;
  flash.value[0x14] = 0x0FFFAAED;  // as delivered (3.9.6)
  const OptionBytes delivered = read_option_bytes(flash);
  EXPECT_FALSE(delivered.has_brown_out_level_3() || delivered.has_hardware_watchdog() ||
               delivered.has_read_protection() || delivered.has_protected_code());
  flash.value[0x14] = 0x0F0055C1;
  const OptionBytes asked = read_option_bytes(flash);
  EXPECT_TRUE(asked.has_brown_out_level_3() && asked.has_hardware_watchdog() &&
              asked.has_read_protection() && asked.has_protected_code());
}

class FakeMpu : public FakeRegisters {
 public:
  FakeMpu() { value[0x00] = 8U << 8; }
};

TEST(Mpu, Regions_AreWrittenAsTheManualSays) {
  FakeMpu registers;
  const std::array regions = {ports::MpuRegion{0x08000000, 1U << 20, ports::Access::kReadOnly,
                                               ports::Memory::kNormal, true},
                              ports::MpuRegion{0x20000000, 1U << 17, ports::Access::kReadWrite},
                              ports::MpuRegion{0x2001F000, 256, ports::Access::kNone}};
  ASSERT_TRUE(ports::start_mpu(registers, regions));
  const std::vector<std::pair<std::uint32_t, std::uint32_t>> expected = {
      {0x04, 0},
      {0x0C, 0x08000010},
      {0x10, 6U << 24 | 1U << 17 | 19U << 1 | 1U},
      {0x0C, 0x20000011},
      {0x10, 1U << 28 | 3U << 24 | 1U << 17 | 16U << 1 | 1U},
      {0x0C, 0x2001F012},
      {0x10, 1U << 28 | 1U << 17 | 7U << 1 | 1U},
      {0x04, 1}};
  EXPECT_EQ(registers.written, expected);
}

TEST(Mpu, MissingUnitOrInvalidRegion_IsNotStarted) {
  FakeRegisters none;
  const std::array one = {ports::MpuRegion{0x20000000, 256, ports::Access::kNone}};
  EXPECT_FALSE(ports::start_mpu(none, one));
  for (const ports::MpuRegion region : {ports::MpuRegion{0x20000080, 256, ports::Access::kNone},
                                        ports::MpuRegion{0x20000000, 100, ports::Access::kNone},
                                        ports::MpuRegion{0x20000000, 16, ports::Access::kNone}}) {
    FakeMpu registers;
    const std::array odd = {region};
    EXPECT_FALSE(ports::start_mpu(registers, odd));
    EXPECT_EQ(registers.read(0x04), 0U) << "and stays off";
  }
}

// Watchdog and supply of a guarded flash; records the timeouts that are set, in order.
struct Calls {
  std::vector<std::string> made;
  bool is_low_now = false;
  static constexpr std::uint32_t kUsualMs = 1000;
  static constexpr std::uint32_t kEraseMs = 8000;
  void set_timeout(std::uint32_t ms) { made.push_back("timeout " + std::to_string(ms)); }
  bool is_low() const { return is_low_now; }
};

class GuardedFlashTest : public testing::Test {
 protected:
  GuardedFlashTest() { memory_.fill(0xFF); }
  std::array<std::uint8_t, 64> memory_;
  storage::RamFlash ram_{memory_};
  Calls calls;
  GuardedFlash<storage::RamFlash, Calls, Calls> flash{ram_, calls, calls};
};

TEST_F(GuardedFlashTest, Erase_RunsWithALongWatchdogTimeout) {
  memory_[0] = 0;
  EXPECT_TRUE(flash.erase(0));
  EXPECT_EQ(memory_[0], 0xFF);
  const std::vector<std::string> expected = {"timeout 8000", "timeout 1000"};
  EXPECT_EQ(calls.made, expected);
}

TEST_F(GuardedFlashTest, LowSupply_NothingIsErasedOrProgrammed) {
  memory_[0] = 0;
  calls.is_low_now = true;
  EXPECT_FALSE(flash.erase(0));
  EXPECT_FALSE(flash.program(1, 0, 0x12345678));
  EXPECT_EQ(memory_[0], 0);
  EXPECT_EQ(memory_[32], 0xFF);
  calls.is_low_now = false;
  EXPECT_TRUE(flash.program(1, 0, 0x12345678));
  EXPECT_EQ(memory_[32], 0x78);
}

}  // namespace
}  // namespace armtrue::stm32f405
