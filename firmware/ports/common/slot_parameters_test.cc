#include "firmware/ports/common/slot_parameters.h"

#include <gtest/gtest.h>

#include <optional>

#include "firmware/storage/simulated_flash.h"

namespace armtrue::ports {
namespace {

using Block = std::array<std::uint8_t, canopen::kParameterBlockSize>;

class SlotParametersTest : public testing::Test {
 protected:
  void SetUp() override { restart(); }

  void restart() {
    parameters_.emplace(flash_);
    parameters_->start();
  }

  static Block block_of(std::uint8_t value) {
    Block block;
    block.fill(value);
    return block;
  }

  storage::SimulatedFlash flash_{16 * 1024, 1};
  std::optional<SlotParameters> parameters_;
  Block loaded_ = {};
};

TEST_F(SlotParametersTest, BlankFlash_HasNothingToLoad) {
  EXPECT_FALSE(parameters_->load(loaded_));
}

TEST_F(SlotParametersTest, SavedBlocksSurviveARestart) {
  for (std::uint8_t value = 1; value <= 4; ++value) {
    ASSERT_TRUE(parameters_->save(block_of(value)));
    ASSERT_TRUE(parameters_->load(loaded_));
    EXPECT_EQ(loaded_, block_of(value));
    restart();
    ASSERT_TRUE(parameters_->load(loaded_));
    EXPECT_EQ(loaded_, block_of(value));
  }
}

TEST_F(SlotParametersTest, Erase_LeavesNothingToLoad) {
  ASSERT_TRUE(parameters_->save(block_of(1)));
  ASSERT_TRUE(parameters_->erase());
  EXPECT_FALSE(parameters_->load(loaded_));
  restart();
  EXPECT_FALSE(parameters_->load(loaded_));
  ASSERT_TRUE(parameters_->save(block_of(2)));
  restart();
  EXPECT_TRUE(parameters_->load(loaded_));
}

TEST_F(SlotParametersTest, DamagedBlock_IsReported_OlderOneIsNotLoaded) {
  ASSERT_TRUE(parameters_->save(block_of(1)));
  ASSERT_TRUE(parameters_->save(block_of(2)));
  EXPECT_FALSE(parameters_->is_damaged());
  for (std::size_t slot = 0; slot < storage::kSlots; ++slot) {
    std::uint32_t& word = flash_.word(slot, storage::kHeaderWords + 5);
    if (word == 0x02020202) word ^= 0x00100000;
  }
  restart();
  EXPECT_FALSE(parameters_->load(loaded_));
  EXPECT_TRUE(parameters_->is_damaged());
  ASSERT_TRUE(parameters_->save(block_of(3)));
  restart();
  ASSERT_TRUE(parameters_->load(loaded_));
  EXPECT_EQ(loaded_, block_of(3));
  EXPECT_FALSE(parameters_->is_damaged());
}

TEST_F(SlotParametersTest, APowerCutLeavesTheOldOrTheNewBlock) {
  for (std::size_t at = 0;; ++at) {
    storage::SimulatedFlash fresh(16 * 1024, static_cast<std::uint32_t>(at));
    flash_ = fresh;
    restart();
    ASSERT_TRUE(parameters_->save(block_of(1)));
    flash_.cut_at(at, storage::CutKind::kTorn);
    bool interrupted = false;
    try {
      ASSERT_TRUE(parameters_->save(block_of(2)));
    } catch (const storage::PowerCut&) {
      interrupted = true;
    }
    flash_.run_undisturbed();
    restart();
    ASSERT_TRUE(parameters_->load(loaded_));
    if (!interrupted) {
      EXPECT_EQ(loaded_, block_of(2));
      EXPECT_GT(at, canopen::kParameterBlockSize / 4);
      break;
    }
    EXPECT_TRUE(loaded_ == block_of(1) || loaded_ == block_of(2)) << "operation " << at;
  }
}

// Flash whose supply is low after `words_until_low` words: programming fails from then on.
class DippingFlash final : public storage::SimulatedFlash {
 public:
  using SimulatedFlash::SimulatedFlash;
  bool program(std::size_t slot, std::size_t offset, std::uint32_t word) override {
    if (words_until_low == 0) return false;
    --words_until_low;
    return SimulatedFlash::program(slot, offset, word);
  }
  std::size_t words_until_low = kNever;
};

TEST_F(SlotParametersTest, FailedSave_KeepsOldBlock_NextSaveSucceeds) {
  for (const bool has_old : {true, false}) {
    for (std::size_t words = 0;; ++words) {
      SCOPED_TRACE(words);
      DippingFlash flash(16 * 1024, 1);
      SlotParameters parameters(flash);
      parameters.start();
      if (has_old) {
        ASSERT_TRUE(parameters.save(block_of(1)));
      }
      flash.words_until_low = words;
      if (parameters.save(block_of(2))) break;
      flash.words_until_low = storage::SimulatedFlash::kNever;
      ASSERT_EQ(parameters.load(loaded_), has_old);
      if (has_old) {
        EXPECT_EQ(loaded_, block_of(1));
      }
      EXPECT_EQ(parameters.holds_something(), has_old);
      ASSERT_TRUE(parameters.save(block_of(3)));
      SlotParameters after_a_restart(flash);
      after_a_restart.start();
      ASSERT_TRUE(after_a_restart.load(loaded_));
      EXPECT_EQ(loaded_, block_of(3));
    }
  }
}

}  // namespace
}  // namespace armtrue::ports
