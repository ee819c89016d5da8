// The set window that is learnt from a controller without SYNC.
#include "firmware/canopen/motion/sets/set_window.h"

#include <gtest/gtest.h>

#include <vector>

namespace armtrue::canopen {
namespace {

class SetWindowTest : public testing::Test {
 protected:
  static constexpr std::uint32_t kConfigured = 100;

  // A set of frames with these gaps between them, then a pause. RPDOs 2, 3, 4 ...
  void set(const std::vector<std::uint64_t>& gaps_us, std::uint64_t pause_us) {
    std::size_t rpdo = 2;
    window.note(rpdo, now_us);
    for (const std::uint64_t gap_us : gaps_us) {
      now_us += gap_us;
      window.note(++rpdo, now_us);
    }
    now_us += pause_us;
  }
  void sets(int count, const std::vector<std::uint64_t>& gaps_us, std::uint64_t pause_us) {
    for (int k = 0; k < count; ++k) set(gaps_us, pause_us);
  }
  // From now on a set consists of the first `count` RPDOs that set() uses.
  void expect_frames(std::size_t count) { window.restart(((1U << count) - 1U) << 2); }
  std::uint32_t in_force() const { return window.in_force(kConfigured); }

  SetWindow window;
  std::uint64_t now_us = 5'000'000;
};

TEST_F(SetWindowTest, EightAgreeingRounds_SetTheWindow) {
  expect_frames(3);
  // A round lasts from a frame to the next of the same RPDO: the ninth set ends the eighth round.
  sets(8, {300, 200}, 1500);
  EXPECT_EQ(in_force(), kConfigured);
  sets(1, {300, 200}, 1500);
  EXPECT_EQ(in_force(), 1100U) << "half-way between 500 and what could be another cycle's, 1700";
  EXPECT_EQ(window.in_force(1100), 1100U);
  EXPECT_EQ(window.in_force(1200), 1200U) << "the longer of both";
}

TEST_F(SetWindowTest, FramesAtTheSameTime_CountAsAGapOfZero) {
  expect_frames(2);
  sets(9, {0}, 1001);
  EXPECT_EQ(in_force(), 501U);
}

TEST_F(SetWindowTest, PauseUpToFiveQuartersOfTheGap_IsNotLearnt) {
  expect_frames(2);
  sets(30, {400}, 500);
  EXPECT_EQ(in_force(), kConfigured);
  sets(9, {400}, 501);
  EXPECT_EQ(in_force(), 451U);
}

TEST_F(SetWindowTest, RoundWithAMissingFrame_RestartsTheCount) {
  expect_frames(3);
  sets(7, {300, 200}, 1500);
  set({300}, 1700);  // its first frame ends the seventh round
  sets(8, {300, 200}, 1500);
  EXPECT_EQ(in_force(), kConfigured);
  sets(1, {300, 200}, 1500);
  EXPECT_EQ(in_force(), 1100U);
}

TEST_F(SetWindowTest, RepeatedFrame_RestartsTheCount) {
  expect_frames(2);
  sets(7, {300}, 1500);
  window.note(2, now_us);
  window.note(3, now_us + 300);
  window.note(3, now_us + 400);
  now_us += 1800;
  sets(1, {300}, 1500);
  EXPECT_EQ(in_force(), kConfigured);
}

TEST_F(SetWindowTest, SlowerRoundsBeforeAnUnclearPause_AreForgotten) {
  expect_frames(2);
  sets(7, {900}, 2000);
  set({900}, 1000);  // no clear pause
  sets(9, {100}, 900);
  EXPECT_EQ(in_force(), 500U);
}

TEST_F(SetWindowTest, SetAsLongAsTheWindowOfAnother_IsNotLearnt) {
  expect_frames(2);
  for (int k = 0; k < 10; ++k) {
    set({100}, 900);   // window 500
    set({500}, 2000);  // takes 500
  }
  EXPECT_EQ(in_force(), kConfigured);
  sets(10, {100}, 900);
  EXPECT_EQ(in_force(), 500U) << "once it is even";
}

TEST_F(SetWindowTest, ChangedPause_IsLearntAfterEightRounds) {
  expect_frames(2);
  sets(8, {100}, 900);
  set({100}, 1900);  // its first frame ends the eighth round
  ASSERT_EQ(in_force(), 500U);
  sets(7, {100}, 1900);
  EXPECT_EQ(in_force(), 500U);
  sets(1, {100}, 1900);
  EXPECT_EQ(in_force(), 1000U);
}

TEST_F(SetWindowTest, OneFasterRound_ShortensTheWindow) {
  expect_frames(3);
  sets(9, {100, 100}, 3800);
  ASSERT_EQ(in_force(), 2050U);
  sets(1, {100, 100}, 800);
  set({}, 0);  // its frame ends the faster round
  EXPECT_EQ(in_force(), 550U);
}

TEST_F(SetWindowTest, OneRoundWithoutAPause_ForgetsWhatWasLearnt) {
  expect_frames(3);
  sets(9, {100, 100}, 3800);
  sets(1, {333, 333}, 334);
  set({}, 0);
  EXPECT_EQ(in_force(), kConfigured);
}

TEST_F(SetWindowTest, OneRound_BoundsTheWindowUntilEightAgree) {
  expect_frames(3);
  sets(1, {100, 60}, 240);
  EXPECT_EQ(window.bound_us(), SetWindow::kUnbounded) << "no round has ended";
  sets(1, {100, 60}, 240);
  EXPECT_EQ(window.bound_us(), 400U - (240 + 100) / 2);
  sets(1, {100, 60}, 200);
  set({100, 60}, 240);
  EXPECT_EQ(window.bound_us(), 360U - (200 + 100) / 2) << "a faster round";
  sets(5, {100, 60}, 240);
  EXPECT_EQ(window.bound_us(), 210U);
  sets(10, {100, 60}, 240);
  EXPECT_EQ(window.bound_us(), 230U);
  EXPECT_EQ(window.learnt_us(), 230U);
}

// The second longest gap lies between the first frame of a set and its second: if the first one is
// lost, the next cycle's comes this much earlier, with a quarter for what the gaps vary.
TEST_F(SetWindowTest, RoundWithoutAClearPause_BoundsTheWindowToo) {
  expect_frames(3);
  sets(2, {100, 80}, 120);
  EXPECT_EQ(window.bound_us(), 300U - 125);
  EXPECT_EQ(window.learnt_us(), 0U);
}

TEST_F(SetWindowTest, LostFrame_KeepsTheWindow) {
  expect_frames(3);
  for (const int lost : {0, 1, 2}) {
    SCOPED_TRACE(lost);
    sets(9, {900, 900}, 2200);
    ASSERT_EQ(in_force(), 2450U);
    if (lost != 0) window.note(2, now_us);
    if (lost != 1) window.note(3, now_us + 900);
    if (lost != 2) window.note(4, now_us + 1800);
    now_us += 4000;
    sets(1, {900, 900}, 2200);
    EXPECT_EQ(in_force(), 2450U);
  }
}

TEST_F(SetWindowTest, Restart_ForgetsWhatWasLearnt) {
  expect_frames(2);
  sets(9, {100}, 900);
  ASSERT_EQ(in_force(), 500U);
  expect_frames(2);
  EXPECT_EQ(in_force(), kConfigured);
}

}  // namespace
}  // namespace armtrue::canopen
