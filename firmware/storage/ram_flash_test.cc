#include "firmware/storage/ram_flash.h"

#include <gtest/gtest.h>

#include <vector>

#include "firmware/storage/slot_store.h"
#include "firmware/storage/test_tables.h"

namespace armtrue::storage {
namespace {

TEST(RamFlash, KeepsTablesAcrossRestarts) {
  std::vector<std::uint8_t> memory(2048, 0x5A);
  RamFlash flash(memory);
  const TestVerifier verifier;
  Image buffer(512);
  SlotStore store(flash, verifier);
  EXPECT_TRUE(store.start(buffer).empty()) << "what happened to be in memory is no table";
  for (std::uint8_t name = 1; name <= 3; ++name) {
    std::span<const std::uint8_t> active;
    ASSERT_EQ(store.commit(make_image(name, 500)), StoreResult::kDone);
    ASSERT_EQ(store.activate(buffer, active), StoreResult::kDone);
    ASSERT_EQ(store.confirm(), StoreResult::kDone);
    SlotStore restarted(flash, verifier);
    EXPECT_TRUE(std::ranges::equal(restarted.start(buffer), make_image(name, 500)));
  }
}

TEST(RamFlash, Start_BlanksAnAllZeroSlot_KeepsOthers) {
  std::vector<std::uint8_t> memory(2048);
  memory[1024] = 7;
  RamFlash flash(memory);
  flash.start();
  EXPECT_EQ(memory[0], 0xFF);
  EXPECT_EQ(memory[1023], 0xFF);
  EXPECT_EQ(memory[1024], 7);
  EXPECT_EQ(memory[1025], 0);
}

TEST(RamFlash, Program_OutsideTheSlotOrUnaligned_IsRefused) {
  std::vector<std::uint8_t> memory(128);
  RamFlash flash(memory);
  EXPECT_EQ(flash.slot_size(), 64U);
  EXPECT_FALSE(flash.program(0, 64, 0));
  EXPECT_FALSE(flash.program(0, 1, 0));
}

}  // namespace
}  // namespace armtrue::storage
