#include "firmware/ports/stm32f405/flash_driver.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <map>
#include <vector>

#include "firmware/storage/slot_store.h"
#include "firmware/storage/test_tables.h"

namespace armtrue::stm32f405 {
namespace {

constexpr std::uint32_t kFirstSector = 10;
constexpr std::uintptr_t kFirstAddress = 0x080C0000;  // RM0090, table 5

// The flash interface: key sequence, lock, busy time, error flags, one operation at a time.
class FakeFlash {
 public:
  int busy_readings = 5;
  bool stays_busy = false;
  std::uint32_t error = 0;  // raised by the next operation

  FakeFlash() { memory_.assign(2 * flash::kSectorBytes / 4, 0xFFFFFFFF); }

  std::uint32_t read(std::uint32_t offset) const {
    switch (offset) {
      case flash::kSr:
        return status_ | (still_busy() ? flash::kSrBusy : 0);
      case flash::kCr:
        return control_;
      case flash::kAcr:
        return cache_;
      default:
        return 0;
    }
  }

  void write(std::uint32_t offset, std::uint32_t value) {
    if (offset == flash::kKeyr) {
      keys_.push_back(value);
      if (keys_ == std::vector<std::uint32_t>{flash::kKey1, flash::kKey2}) control_ = 0;
    } else if (offset == flash::kSr) {
      status_ &= ~value;
    } else if (offset == flash::kAcr) {
      if ((value & flash::kAcrDataCacheReset) != 0 && (value & flash::kAcrDataCache) == 0)
        ++cache_resets;
      cache_ = value;
    } else if (offset == flash::kCr && (control_ & flash::kCrLock) == 0) {
      control_ = value;
      if ((value & flash::kCrLock) != 0) keys_.clear();
      if ((value & flash::kCrStart) != 0) erase(value >> flash::kCrSectorShift & 0xF);
    }
  }

  std::uint32_t load(std::uintptr_t address) const {
    return memory_.at((address - kFirstAddress) / 4);
  }

  void store(std::uintptr_t address, std::uint32_t word) {
    EXPECT_EQ(control_, flash::kCrProgram | flash::kCrWords)
        << "stored without being told to program";
    if (!start_operation()) return;
    memory_.at((address - kFirstAddress) / 4) &= word;
  }

  bool is_locked() const { return (control_ & flash::kCrLock) != 0; }

  int cache_resets = 0;
  std::vector<std::uint32_t> erased;

 private:
  bool still_busy() const { return stays_busy || (busy_left_ > 0 && busy_left_-- > 0); }

  bool start_operation() {
    busy_left_ = busy_readings;
    status_ |= error;
    return std::exchange(error, 0) == 0;
  }

  void erase(std::uint32_t sector) {
    erased.push_back(sector);
    if (!start_operation()) return;
    const std::size_t begin = (sector - kFirstSector) * flash::kSectorBytes / 4;
    std::fill_n(memory_.begin() + static_cast<std::ptrdiff_t>(begin), flash::kSectorBytes / 4,
                0xFFFFFFFF);
  }

  std::vector<std::uint32_t> memory_;
  std::vector<std::uint32_t> keys_;
  std::uint32_t control_ = flash::kCrLock;
  std::uint32_t status_ = 0;
  std::uint32_t cache_ = flash::kAcrDataCache;
  mutable int busy_left_ = 0;
};

class FlashDriverTest : public testing::Test {
 protected:
  static constexpr std::uint32_t kPolls = 100;
  FakeFlash fake_;
  FlashDriver<FakeFlash, FakeFlash> flash_{fake_, fake_, kFirstSector, kPolls};
};

TEST_F(FlashDriverTest, ProgramsOneWordAndLocksAgain) {
  ASSERT_TRUE(flash_.program(1, 8, 0x11223344));
  EXPECT_EQ(fake_.load(kFirstAddress + flash::kSectorBytes + 8), 0x11223344U);
  EXPECT_TRUE(fake_.is_locked());
}

TEST_F(FlashDriverTest, Read_AtAnyByteOffset_ReturnsTheBytes) {
  ASSERT_TRUE(flash_.program(0, 0, 0x03020100));
  ASSERT_TRUE(flash_.program(0, 4, 0x07060504));
  std::vector<std::uint8_t> bytes(5);
  flash_.read(0, 2, bytes);
  EXPECT_EQ(bytes, (std::vector<std::uint8_t>{2, 3, 4, 5, 6}));
}

TEST_F(FlashDriverTest, Erase_ClearsItsSectorAndResetsTheDataCache) {
  ASSERT_TRUE(flash_.program(0, 0, 0));
  ASSERT_TRUE(flash_.program(1, 0, 0));
  ASSERT_TRUE(flash_.erase(1));
  EXPECT_EQ(fake_.erased, std::vector<std::uint32_t>{kFirstSector + 1});
  EXPECT_EQ(fake_.load(kFirstAddress), 0U);
  EXPECT_EQ(fake_.load(kFirstAddress + flash::kSectorBytes), 0xFFFFFFFFU);
  EXPECT_EQ(fake_.cache_resets, 1);
  EXPECT_EQ(fake_.read(flash::kAcr), flash::kAcrDataCache) << "the cache is on again";
  EXPECT_TRUE(fake_.is_locked());
}

TEST_F(FlashDriverTest, ErrorFlag_FailsItsOperation_NextOneSucceeds) {
  for (const std::uint32_t bit : {1U, 4U, 5U, 6U, 7U}) {
    fake_.error = 1U << bit;
    EXPECT_FALSE(flash_.program(0, 0, 0)) << "bit " << bit;
    EXPECT_TRUE(fake_.is_locked());
    EXPECT_TRUE(flash_.program(0, 4 * bit, 0));
    fake_.error = 1U << bit;
    EXPECT_FALSE(flash_.erase(0)) << "bit " << bit;
    EXPECT_TRUE(flash_.erase(0));
  }
}

TEST_F(FlashDriverTest, ControllerThatStaysBusy_FailsTheOperation) {
  fake_.stays_busy = true;
  EXPECT_FALSE(flash_.program(0, 0, 0));
  EXPECT_FALSE(flash_.erase(0));
}

TEST_F(FlashDriverTest, Program_OutsideTheSlotOrUnaligned_IsRefused) {
  EXPECT_FALSE(flash_.program(0, 2, 0));
  EXPECT_FALSE(flash_.program(0, flash::kSectorBytes, 0));
}

TEST_F(FlashDriverTest, SlotStore_RunsOnThisDriver) {
  const storage::TestVerifier verifier;
  storage::Image buffer(1000);
  storage::SlotStore store(flash_, verifier);
  EXPECT_TRUE(store.start(buffer).empty());
  const storage::Image table = storage::make_image(7, 999);
  ASSERT_EQ(store.commit(table), storage::StoreResult::kDone);
  std::span<const std::uint8_t> active;
  ASSERT_EQ(store.activate(buffer, active), storage::StoreResult::kDone);
  ASSERT_EQ(store.confirm(), storage::StoreResult::kDone);
  storage::SlotStore after_restart(flash_, verifier);
  EXPECT_TRUE(std::ranges::equal(after_restart.start(buffer), table));
}

}  // namespace
}  // namespace armtrue::stm32f405
