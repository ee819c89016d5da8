// Which frames form a set: SetAssembler alone, without a node.
#include "firmware/canopen/motion/sets/set_assembler.h"

#include <gtest/gtest.h>

#include "firmware/testing/simulated_port.h"

namespace armtrue::canopen {
namespace {

constexpr std::uint32_t kWindowUs = 500;
constexpr std::uint32_t kBoth = 3;  // axes 1 and 2

// RPDO k + 1 carries the target of axis k + 1, the first RPDO a temperature.
class SetAssemblerTest : public testing::Test {
 protected:
  SetAssemblerTest() {
    dictionary.restore_defaults(0x20);
    map(0, 0x20200110);
    map(1, 0x607A0020);
    map(2, 0x687A0020);
  }
  void map(std::size_t rpdo, std::uint32_t word) {
    dictionary.set(od::rpdo::kCOBID[rpdo], 0x300U + static_cast<std::uint32_t>(rpdo));
    dictionary.set(od::rpdo::kMappingCount[rpdo], 1);
    dictionary.set(od::rpdo::kMapping[rpdo], word);
  }
  void configure(std::uint8_t transmission) {
    for (const std::size_t rpdo : {1U, 2U}) {
      dictionary.set(od::rpdo::kTransmissionType[rpdo], transmission);
    }
    pdos.refresh();
    sets.configure(pdos);
  }
  SetEvent take(std::size_t rpdo, int value, std::uint64_t now_us = 0) {
    return sets.take(pdos.rpdo(rpdo), rpdo, make_frame(0x300, {value, value, 0, 0}), now_us);
  }
  // A whole set goes out, and its interval ends.
  void send_set(int value) {
    take(1, value);
    take(2, value);
    sets.set_progress(SetProgress::kOut);
    ASSERT_EQ(sets.end_interval(), SetAssembler::Ended::kEmptyOrOut);
  }

  ObjectDictionary dictionary;
  PdoTable pdos{dictionary, kClassicPayload};
  SetAssembler sets;
};

TEST_F(SetAssemblerTest, OnlyRpdosWithTargets_BelongToTheSet) {
  configure(255);
  EXPECT_TRUE(sets.has_targets_of(kBoth));
  EXPECT_FALSE(sets.carries_target(0));
  EXPECT_TRUE(sets.carries_target(1));
  EXPECT_TRUE(sets.carries_target(2));
}

TEST_F(SetAssemblerTest, AJointWithoutATarget_MeansNoSet) {
  map(1, 0x20200110);
  configure(255);
  EXPECT_FALSE(sets.has_targets_of(kBoth)) << "joint 1 is missing";
  EXPECT_TRUE(sets.has_targets_of(2)) << "where joint 1 has no drive, none is";
  map(1, 0x607A0020);
  configure(255);
  EXPECT_FALSE(sets.has_targets_of(7)) << "joint 3 is missing";
}

TEST_F(SetAssemblerTest, Configure_DropsThePartialSet) {
  configure(1);
  EXPECT_EQ(take(1, 5), SetEvent::kHeld);
  configure(1);
  EXPECT_TRUE(sets.frames().empty());
  EXPECT_EQ(take(2, 5), SetEvent::kHeld) << "the first frame is gone";
}

TEST_F(SetAssemblerTest, Drop_WithholdsTheNextSet) {
  configure(255);
  send_set(5);
  EXPECT_EQ(take(1, 6), SetEvent::kHeld);
  sets.drop();
  EXPECT_TRUE(sets.frames().empty());
  take(1, 7);
  EXPECT_EQ(take(2, 7), SetEvent::kHeld) << "not the first set behind it";
}

TEST_F(SetAssemblerTest, IncompleteSet_WithholdsTheNextEvenIfItRepeatsTargets) {
  for (const std::size_t rpdo : {1U, 2U}) {
    for (const int value : {5, 6}) {
      configure(255);
      send_set(5);
      send_set(5);
      take(rpdo, value);
      EXPECT_EQ(sets.end_interval(), SetAssembler::Ended::kWithheld) << rpdo;
      take(1, 7);
      EXPECT_EQ(take(2, 7), SetEvent::kHeld) << "the other frame could have been late";
      sets.end_interval();
      take(1, 8);
      EXPECT_EQ(take(2, 8), SetEvent::kReady);
    }
  }
}

// A SYNC every millisecond, a set behind every second, third, fifth one.
TEST_F(SetAssemblerTest, TargetsSlowerThanSync_GoOutOnceTheirPauseIsKnown) {
  for (const int every : {2, 3, 5}) {
    sets = {};
    configure(255);
    std::uint64_t now_us = 0;
    for (int k = 0; k < 10 * every; ++k) {
      sets.end_interval();
      sets.note_sync(now_us += 1000);
      if (k % every != 0) continue;
      take(1, k, now_us + 100);
      const bool is_ready = take(2, k, now_us + 200) == SetEvent::kReady;
      EXPECT_EQ(is_ready, k > every) << "one set of " << every << " at " << k;
      if (is_ready) sets.set_progress(SetProgress::kOut);
    }
    // Nothing for a whole cycle: its frames may still arrive.
    for (int k = 0; k < every + 1; ++k) {
      sets.end_interval();
      sets.note_sync(now_us += 1000);
    }
    take(1, 7, now_us + 100);
    EXPECT_EQ(take(2, 7, now_us + 200), SetEvent::kHeld);
  }
}

TEST_F(SetAssemblerTest, RepeatedFrameAfterItsSetWithoutSync_StartsNoInterval) {
  configure(255);
  std::uint64_t now_us = 0;
  for (int k = 0; k < 12; ++k) {  // a window of 500 us is learnt
    take(1, k, now_us += 1'000);
    if (take(2, k, now_us + 200) == SetEvent::kReady) sets.set_progress(SetProgress::kOut);
    sets.end_interval();
  }
  ASSERT_EQ(sets.window_us(0), 500U);
  EXPECT_EQ(take(2, 11, now_us + 499), SetEvent::kRepeated);
  EXPECT_TRUE(sets.frames().empty());
  EXPECT_EQ(take(2, 11, now_us + 500), SetEvent::kHeld) << "may be of the next cycle";
  EXPECT_EQ(take(1, 12, now_us + 600), SetEvent::kReady);
}

TEST_F(SetAssemblerTest, EqualTargets_AreRepeatsAndTheNewestFrameGoesOut) {
  configure(1);
  sets.note_sync(1'000);
  take(1, 5);
  CanFrame longer = make_frame(0x300, {5, 5, 0, 0, 9});
  EXPECT_EQ(sets.take(pdos.rpdo(1), 1, longer, 0), SetEvent::kRepeated)
      << "no target is mapped to 9";
  EXPECT_EQ(sets.frames()[0].frame.len, 5);
  longer.data[0] = 6;
  EXPECT_EQ(sets.take(pdos.rpdo(1), 1, longer, 0), SetEvent::kContradicted);
}

TEST_F(SetAssemblerTest, AWholeSet_WaitsForItsSyncForTwoIntervals) {
  configure(1);
  sets.note_sync(1'000);
  sets.note_sync(2'000);
  take(1, 5, 2'100);
  take(2, 5, 2'200);
  EXPECT_FALSE(sets.is_over(kWindowUs, 10'000)) << "it is whole";
  EXPECT_TRUE(sets.is_on_time(kWindowUs, 4'100));
  EXPECT_FALSE(sets.is_on_time(kWindowUs, 4'101));
}

TEST_F(SetAssemblerTest, OneLateOrLostSync_KeepsTheMeasuredInterval) {
  for (const std::uint64_t late_us : {600U, 900U, 1'000U, 1'500U}) {
    SCOPED_TRACE(late_us);
    configure(1);
    std::uint64_t now_us = 0;
    for (int k = 0; k < 10; ++k) sets.note_sync(now_us += 1'000);
    // At each SYNC after the late one, a set is ready that came just after the previous SYNC.
    sets.note_sync(now_us + 1'000 + late_us);
    for (std::uint64_t sync_us = now_us + 2'000; sync_us < now_us + 7'000; sync_us += 1'000) {
      if (sync_us <= now_us + 1'000 + late_us) continue;  // lost, or the late one itself
      sets.note_sync(sync_us);
      take(1, 5, sync_us + 10);
      EXPECT_FALSE(sets.is_over(kWindowUs, sync_us + 760)) << "three quarters for what is missing";
      take(2, 5, sync_us + 770);
      EXPECT_TRUE(sets.is_on_time(kWindowUs, sync_us + 1'000)) << sync_us - now_us;
      EXPECT_FALSE(sets.is_on_time(kWindowUs, sync_us + 2'011)) << "nor is an old set a new one";
      sets.end_interval();
    }
  }
}

TEST_F(SetAssemblerTest, NewSyncInterval_IsUsedOnceItCameTwice) {
  configure(1);
  for (std::uint64_t us = 1'000; us <= 5'000; us += 1'000) sets.note_sync(us);
  sets.note_sync(9'000);
  sets.note_sync(13'000);
  take(1, 5, 13'100);
  take(2, 5, 13'200);
  EXPECT_TRUE(sets.is_on_time(kWindowUs, 21'100));
  EXPECT_FALSE(sets.is_on_time(kWindowUs, 21'101));
}

TEST_F(SetAssemblerTest, AnAxisMappedTwice_MeansNoSet) {
  map(3, 0x607A0020);
  configure(1);
  EXPECT_FALSE(sets.has_targets_of(kBoth)) << "by two RPDOs";
  dictionary.set(od::rpdo::kCOBID[3], 0x80000303U);
  configure(1);
  EXPECT_TRUE(sets.has_targets_of(kBoth)) << "of which one is off";
  dictionary.set(od::rpdo::kMappingCount[2], 2);
  auto second = od::rpdo::kMapping[2];
  second.offset = static_cast<std::uint16_t>(second.offset + 4);
  dictionary.set(second, 0x687A0020U);
  configure(1);
  EXPECT_FALSE(sets.has_targets_of(kBoth)) << "twice by one";
}

TEST_F(SetAssemblerTest, BeforeTheSecondSync_AWholeSetWaitsForTheSetWindow) {
  configure(1);
  take(1, 5, 2'100);
  take(2, 5, 2'200);
  EXPECT_TRUE(sets.is_on_time(kWindowUs, 2'600));
  EXPECT_FALSE(sets.is_on_time(kWindowUs, 2'601));
}

TEST_F(SetAssemblerTest, PartialSet_WaitsForThreeQuartersOfAnInterval) {
  configure(1);
  sets.note_sync(1'000);
  sets.note_sync(2'000);
  take(1, 5, 2'100);
  EXPECT_FALSE(sets.is_over(kWindowUs, 2'850));
  EXPECT_TRUE(sets.is_over(kWindowUs, 2'851));
  EXPECT_FALSE(sets.is_over(900, 3'000)) << "or for the set window, if that is longer";
}

TEST_F(SetAssemblerTest, WithoutSync_PartialSetWaitsForTheSetWindow) {
  configure(255);
  take(1, 5, 2'000);
  EXPECT_FALSE(sets.is_over(kWindowUs, 2'500));
  EXPECT_TRUE(sets.is_over(kWindowUs, 2'501));
}

}  // namespace
}  // namespace armtrue::canopen
