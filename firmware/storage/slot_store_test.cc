#include "firmware/storage/slot_store.h"

#include <gtest/gtest.h>

#include <algorithm>

#include "firmware/core/crypto/crc32.h"
#include "firmware/storage/simulated_flash.h"
#include "firmware/storage/slot_format.h"
#include "firmware/storage/test_tables.h"

namespace armtrue::storage {
namespace {

constexpr std::size_t kSlotSize = 1024;

class SlotStoreTest : public testing::Test {
 protected:
  // A restart: a new store over the same flash. Returns a copy of the active image, empty for none.
  Image restart() {
    store_.emplace(flash_, verifier_);
    const std::span<const std::uint8_t> active = store_->start(buffer_);
    return {active.begin(), active.end()};
  }

  void install(const Image& image) {
    ASSERT_EQ(store_->commit(image), StoreResult::kDone);
    std::span<const std::uint8_t> active;
    ASSERT_EQ(store_->activate(buffer_, active), StoreResult::kDone);
    ASSERT_TRUE(std::ranges::equal(active, image));
    ASSERT_EQ(store_->confirm(), StoreResult::kDone);
  }

  SlotState state(std::size_t slot) const { return store_->status().slot[slot].state; }

  SimulatedFlash flash_{kSlotSize, 1};
  TestVerifier verifier_;
  Image buffer_ = Image(kSlotSize);
  std::optional<SlotStore> store_;
};

TEST_F(SlotStoreTest, BlankFlashIsPassThrough) {
  EXPECT_TRUE(restart().empty());
  EXPECT_EQ(store_->status().active, std::nullopt);
  EXPECT_EQ(state(0), SlotState::kBlank);
  EXPECT_EQ(state(1), SlotState::kBlank);
  for (const SlotStatus& slot : store_->status().slot) EXPECT_EQ(slot.length, 0U);
}

TEST_F(SlotStoreTest, ConfirmedTableSurvivesRestart) {
  restart();
  const Image table = make_image(1, 101);
  install(table);
  EXPECT_EQ(restart(), table);
  EXPECT_EQ(state(*store_->status().active), SlotState::kConfirmed);
}

TEST_F(SlotStoreTest, Tables_AlternateSlots_OlderOneIsTheFallback) {
  restart();
  for (std::uint8_t name = 1; name <= 5; ++name) {
    install(make_image(name, 200));
    EXPECT_EQ(restart(), make_image(name, 200));
    EXPECT_EQ(store_->status().slot[*store_->status().active].sequence, name);
  }
  const std::size_t active = *store_->status().active;
  flash_.word(active, kHeaderWords + 3) ^= 0x100;
  EXPECT_EQ(restart(), make_image(4, 200));
  EXPECT_EQ(state(active), SlotState::kTorn);
}

TEST_F(SlotStoreTest, UnconfirmedTrialEndsWithTheRestart) {
  restart();
  const Image old_table = make_image(1, 80);
  install(old_table);
  ASSERT_EQ(store_->commit(make_image(2, 90)), StoreResult::kDone);
  std::span<const std::uint8_t> active;
  ASSERT_EQ(store_->activate(buffer_, active), StoreResult::kDone);
  const std::size_t trial = *store_->status().active;
  EXPECT_EQ(restart(), old_table);
  EXPECT_EQ(state(trial), SlotState::kRejected);
  EXPECT_EQ(restart(), old_table);
}

TEST_F(SlotStoreTest, PendingTableWaitsAcrossRestarts) {
  restart();
  const Image old_table = make_image(1, 80);
  const Image new_table = make_image(2, 80);
  install(old_table);
  ASSERT_EQ(store_->commit(new_table), StoreResult::kDone);
  EXPECT_EQ(restart(), old_table);
  std::span<const std::uint8_t> active;
  ASSERT_EQ(store_->activate(buffer_, active), StoreResult::kDone);
  EXPECT_TRUE(std::ranges::equal(active, new_table));
}

TEST_F(SlotStoreTest, RevertReturnsToTheConfirmedTable) {
  restart();
  const Image old_table = make_image(1, 80);
  install(old_table);
  ASSERT_EQ(store_->commit(make_image(2, 80)), StoreResult::kDone);
  std::span<const std::uint8_t> active;
  ASSERT_EQ(store_->activate(buffer_, active), StoreResult::kDone);
  ASSERT_EQ(store_->revert(), StoreResult::kDone);
  EXPECT_TRUE(std::ranges::equal(store_->load_active(buffer_), old_table));
  EXPECT_EQ(store_->confirm(), StoreResult::kNoTrial);
  EXPECT_EQ(restart(), old_table);
}

TEST_F(SlotStoreTest, RevertDropsAPendingTable) {
  restart();
  ASSERT_EQ(store_->commit(make_image(2, 80)), StoreResult::kDone);
  ASSERT_EQ(store_->revert(), StoreResult::kDone);
  std::span<const std::uint8_t> active;
  EXPECT_EQ(store_->activate(buffer_, active), StoreResult::kNothingPending);
  restart();
  EXPECT_EQ(store_->activate(buffer_, active), StoreResult::kNothingPending);
}

TEST_F(SlotStoreTest, LaterCommit_ReplacesThePendingTable) {
  restart();
  ASSERT_EQ(store_->commit(make_image(1, 80)), StoreResult::kDone);
  ASSERT_EQ(store_->commit(make_image(2, 80)), StoreResult::kDone);
  std::span<const std::uint8_t> active;
  ASSERT_EQ(store_->activate(buffer_, active), StoreResult::kDone);
  EXPECT_TRUE(std::ranges::equal(active, make_image(2, 80)));
}

TEST_F(SlotStoreTest, Commit_DuringATrial_IsRefused) {
  restart();
  ASSERT_EQ(store_->commit(make_image(1, 80)), StoreResult::kDone);
  std::span<const std::uint8_t> active;
  ASSERT_EQ(store_->activate(buffer_, active), StoreResult::kDone);
  EXPECT_EQ(store_->commit(make_image(2, 80)), StoreResult::kTrialRunning);
}

TEST_F(SlotStoreTest, OnlyAcceptedTablesAreCommitted) {
  restart();
  for (const TableVerdict verdict :
       {TableVerdict::kForeign, TableVerdict::kNewer, TableVerdict::kRefused}) {
    EXPECT_EQ(store_->commit(make_image(1, 80, verdict)), StoreResult::kTableRefused);
  }
  EXPECT_EQ(flash_.erases(), 0u);
}

TEST_F(SlotStoreTest, ImageMustFitTheSlot) {
  restart();
  EXPECT_EQ(store_->capacity(), kSlotSize - kHeaderBytes);
  EXPECT_EQ(store_->commit(make_image(1, store_->capacity() + 1)), StoreResult::kTooLarge);
  EXPECT_EQ(store_->commit({}), StoreResult::kTooLarge);
  const Image largest = make_image(1, store_->capacity());
  install(largest);
  EXPECT_EQ(restart(), largest);
}

TEST_F(SlotStoreTest, ActivationNeedsABufferThatHoldsTheImage) {
  restart();
  ASSERT_EQ(store_->commit(make_image(1, 80)), StoreResult::kDone);
  std::span<const std::uint8_t> active;
  EXPECT_EQ(store_->activate(std::span(buffer_).first(79), active), StoreResult::kTooLarge);
  EXPECT_EQ(store_->status().active, std::nullopt);
}

TEST_F(SlotStoreTest, EveryImageSizeIsKeptExactly) {
  restart();
  for (std::size_t size = 2; size < 80; ++size) {
    install(make_image(static_cast<std::uint8_t>(size), size));
    ASSERT_EQ(restart(), make_image(static_cast<std::uint8_t>(size), size));
  }
}

TEST_F(SlotStoreTest, NoWordIsProgrammedTwiceBetweenErases) {
  restart();
  for (std::uint8_t name = 1; name <= 4; ++name) {
    install(make_image(name, 333));
    restart();
    ASSERT_EQ(store_->commit(make_image(99, 70)), StoreResult::kDone);
    ASSERT_EQ(store_->revert(), StoreResult::kDone);
    restart();
  }
  EXPECT_EQ(flash_.reprogrammed(), 0u);
}

TEST_F(SlotStoreTest, DamagedNewestTable_IsReported_OlderOneIsActive) {
  restart();
  install(make_image(1, 80));
  install(make_image(2, 80));
  EXPECT_FALSE(store_->has_lost_newest());
  const std::size_t newest = *store_->status().active;
  flash_.word(newest, kHeaderWords + 3) ^= 0x100;
  EXPECT_EQ(restart(), make_image(1, 80));
  EXPECT_TRUE(store_->has_lost_newest());
  install(make_image(3, 80));
  restart();
  EXPECT_FALSE(store_->has_lost_newest());
}

TEST_F(SlotStoreTest, DamagedOnlyTable_IsReported_NoneIsActive) {
  restart();
  install(make_image(1, 80));
  flash_.word(*store_->status().active, kHeaderWords + 3) ^= 0x100;
  EXPECT_TRUE(restart().empty());
  EXPECT_TRUE(store_->has_lost_newest());
}

TEST_F(SlotStoreTest, DamagedOlderTable_IsNotReported) {
  restart();
  install(make_image(1, 80));
  install(make_image(2, 80));
  flash_.word(1 - *store_->status().active, kHeaderWords + 3) ^= 0x100;
  EXPECT_EQ(restart(), make_image(2, 80));
  EXPECT_FALSE(store_->has_lost_newest());
}

TEST_F(SlotStoreTest, PowerCutDuringCommit_KeepsTheActiveTable) {
  for (const CutKind kind : kAllCutKinds) {
    for (std::size_t at = 0;; ++at) {
      flash_ = SimulatedFlash(kSlotSize, static_cast<std::uint32_t>(at));
      restart();
      install(make_image(1, 40));
      install(make_image(2, 40));
      flash_.cut_at(at, kind);
      bool was_cut = false;
      try {
        store_->commit(make_image(3, 40));
      } catch (const PowerCut&) {
        was_cut = true;
      }
      flash_.run_undisturbed();
      EXPECT_EQ(restart(), make_image(2, 40)) << "operation " << at;
      EXPECT_FALSE(store_->has_lost_newest()) << "operation " << at;
      if (!was_cut) break;
    }
  }
}

TEST_F(SlotStoreTest, ContentNotWrittenByAStore_IsForeign) {
  for (std::size_t i = 0; i < kSlotSize / 4; ++i) flash_.word(1, i) = 0x12345678;
  EXPECT_TRUE(restart().empty());
  EXPECT_EQ(state(1), SlotState::kForeign);
  install(make_image(1, 80));
  EXPECT_EQ(store_->status().active, 0u) << "the blank slot is taken first";
  install(make_image(2, 80));
  EXPECT_EQ(restart(), make_image(2, 80));
}

TEST_F(SlotStoreTest, TableThatNoLongerVerifies_StateGivesTheReason) {
  const struct {
    TableVerdict verdict;
    SlotState state;
  } cases[] = {{TableVerdict::kForeign, SlotState::kForeign},
               {TableVerdict::kNewer, SlotState::kNewer},
               {TableVerdict::kRefused, SlotState::kRefused}};
  for (const auto& [verdict, expected] : cases) {
    // A verifier that accepts everything stands for the firmware (or key, or serial) with which the
    // slot was written.
    struct : TableVerifier {
      TableVerdict verify(std::span<const std::uint8_t>) const override {
        return TableVerdict::kAccepted;
      }
    } credulous;
    flash_.erase(0);
    SlotStore writer(flash_, credulous);
    writer.start(buffer_);
    ASSERT_EQ(writer.commit(make_image(1, 80, verdict)), StoreResult::kDone);
    std::span<const std::uint8_t> active;
    ASSERT_EQ(writer.activate(buffer_, active), StoreResult::kDone);
    ASSERT_EQ(writer.confirm(), StoreResult::kDone);

    EXPECT_TRUE(restart().empty());
    EXPECT_EQ(state(*writer.status().active), expected);
    for (std::size_t slot = 0; slot < kSlots; ++slot) flash_.erase(slot);
  }
}

TEST_F(SlotStoreTest, SlotOfNewerLayout_IsKept_OtherSlotIsUsed) {
  HeaderWords words;
  words.fill(kBlankWord);
  words[kErasedAt] = kErasedMark;
  words[kBegunAt] = kBegunMark;
  words[kMagicAt] = kMagic;
  words[kVersionAt] = kLayoutVersion + 1;
  words[kSequenceAt] = 7;
  words[kLengthAt] = 100;
  words[kImageCrcAt] = 0x1234;
  words[kJournalAt] = words[kJournalAt + 1] = journal_entry(words, Mark::kSealed);
  for (std::size_t i = 0; i < words.size(); ++i) flash_.word(0, i) = words[i];

  EXPECT_TRUE(restart().empty());
  EXPECT_EQ(state(0), SlotState::kNewer);
  EXPECT_EQ(store_->status().slot[0].sequence, 7u);
  install(make_image(1, 80));
  EXPECT_EQ(store_->status().active, 1u);
  EXPECT_EQ(store_->status().slot[1].sequence, 8u);
}

TEST_F(SlotStoreTest, InterruptedUpload_IsTorn_NextOneReplacesIt) {
  restart();
  install(make_image(1, 80));
  flash_.cut_at(10, CutKind::kAfter);
  EXPECT_THROW(store_->commit(make_image(2, 80)), PowerCut);
  flash_.run_undisturbed();
  restart();
  const std::size_t spare = 1 - *store_->status().active;
  EXPECT_EQ(state(spare), SlotState::kTorn);
  EXPECT_EQ(store_->commit(make_image(3, 80)), StoreResult::kDone);
  EXPECT_EQ(state(spare), SlotState::kPending);
}

TEST_F(SlotStoreTest, DamagedHeaderBit_FallsBackToTheOlderTable) {
  restart();
  const Image old_table = make_image(1, 40);
  const Image new_table = make_image(2, 40);
  install(old_table);
  install(new_table);
  const std::size_t active = *store_->status().active;
  for (std::size_t word = kMagicAt; word < kFieldsEnd; ++word) {
    for (std::uint32_t bit = 0; bit < 32; ++bit) {
      flash_.word(active, word) ^= 1u << bit;
      ASSERT_EQ(restart(), old_table) << "word " << word << " bit " << bit;
      flash_.word(active, word) ^= 1u << bit;
    }
  }
  ASSERT_EQ(restart(), new_table);
}

TEST_F(SlotStoreTest, FailedCommit_IsReported_OldTableStays) {
  for (const auto& [step, result] :
       {std::pair{0, StoreResult::kEraseFailed}, std::pair{8, StoreResult::kProgramFailed}}) {
    flash_ = SimulatedFlash(kSlotSize, 1);
    restart();
    const Image old_table = make_image(1, 80);
    install(old_table);
    flash_.fail_at(step);
    EXPECT_EQ(store_->commit(make_image(2, 80)), result);
    flash_.run_undisturbed();
    EXPECT_EQ(restart(), old_table);
    install(make_image(3, 80));
    EXPECT_EQ(restart(), make_image(3, 80));
  }
}

TEST_F(SlotStoreTest, Header_IsWrittenAsByEarlierFirmware) {
  restart();
  install(make_image(1, 80));
  Image header(kHeaderBytes);
  flash_.read(0, 0, header);
  // Changes only with the layout's version: a table outlives an update of the firmware.
  EXPECT_EQ(crc32(header), 0xDDEB3957U) << std::hex << crc32(header);
}

TEST_F(SlotStoreTest, ConfirmMark_IsWrittenTwice) {
  restart();
  ASSERT_EQ(store_->commit(make_image(1, 80)), StoreResult::kDone);
  std::span<const std::uint8_t> active;
  ASSERT_EQ(store_->activate(buffer_, active), StoreResult::kDone);
  const std::size_t before = flash_.operations();
  ASSERT_EQ(store_->confirm(), StoreResult::kDone);
  EXPECT_EQ(flash_.operations() - before, 2U);
}

TEST_F(SlotStoreTest, FailedFirstCommit_IsTorn_NotReportedAsLost) {
  for (const auto& [step, result] :
       {std::pair{0, StoreResult::kEraseFailed}, std::pair{8, StoreResult::kProgramFailed}}) {
    flash_ = SimulatedFlash(kSlotSize, 1);
    restart();
    flash_.fail_at(step);
    ASSERT_EQ(store_->commit(make_image(1, 80)), result);
    EXPECT_EQ(state(0), SlotState::kTorn);
    EXPECT_EQ(store_->status().slot[0].sequence, 0u);
    EXPECT_FALSE(store_->has_lost_newest());
  }
}

TEST_F(SlotStoreTest, SequenceNumbersDoNotWrap) {
  restart();
  install(make_image(1, 80));
  const std::size_t active = *store_->status().active;
  HeaderWords words;
  for (std::size_t i = 0; i < words.size(); ++i) words[i] = flash_.word(active, i);
  words[kSequenceAt] = UINT32_MAX;
  flash_.word(active, kSequenceAt) = UINT32_MAX;
  for (const std::size_t last :
       {read_journal(words).free_at - 1, read_journal(words).free_at - 2}) {
    flash_.word(active, last) = journal_entry(words, Mark::kConfirmed);
  }
  EXPECT_EQ(restart(), make_image(1, 80));
  EXPECT_EQ(store_->commit(make_image(2, 80)), StoreResult::kSequenceExhausted);
}

}  // namespace
}  // namespace armtrue::storage
