#include "firmware/canopen/motion/sets/set_window.h"

#include <algorithm>
#include <bit>

namespace armtrue::canopen {

void SetWindow::restart(std::uint32_t expected) {
  *this = {};
  expected_ = expected;
}

void SetWindow::begin_round(std::uint64_t now_us) {
  seen_ = 1U << anchor_;
  frames_ = 1;
  longest_us_ = 0;
  second_us_ = 0;
  total_us_ = 0;
  last_us_ = now_us;
}

void SetWindow::note(std::size_t rpdo, std::uint64_t now_us) {
  const std::uint32_t bit = 1U << rpdo;
  if (seen_ == 0) {
    anchor_ = static_cast<std::uint8_t>(rpdo);
    return begin_round(now_us);
  }
  const auto gap_us =
      static_cast<std::uint32_t>(std::min<std::uint64_t>(now_us - last_us_, 1'000'000));
  last_us_ = now_us;
  total_us_ += gap_us;
  second_us_ = std::max(second_us_, std::min(longest_us_, gap_us));
  longest_us_ = std::max(longest_us_, gap_us);
  if (rpdo == anchor_) {
    end_round();
    return begin_round(now_us);
  }
  seen_ |= bit;
  ++frames_;
}

void SetWindow::end_round() {
  const bool has_each_once =
      seen_ == expected_ && frames_ == static_cast<std::uint32_t>(std::popcount(expected_));
  const std::uint32_t clear_us = second_us_ * kPauseQuarters / 4U;
  const bool has_pause = longest_us_ > clear_us;
  // A lost frame hides the pause: the round proves nothing.
  if (!has_each_once) {
    agreed_ = 0;
    return;
  }
  // Half-way between the last frame of a set (total - longest) and the earliest frame of the next
  // cycle that could replace a missing first one (total - second).
  const std::uint32_t window_us =
      total_us_ - (has_pause ? (longest_us_ + second_us_) / 2 : clear_us);
  bound_us_ = std::min(bound_us_, window_us);
  if (!has_pause) {  // that would separate the sets
    agreed_ = 0;
    is_learnt_ = false;
    return;
  }
  const std::uint32_t span_us = total_us_ - longest_us_;
  candidate_us_ = agreed_ == 0 ? window_us : std::min(candidate_us_, window_us);
  widest_us_ = agreed_ == 0 ? span_us : std::max(widest_us_, span_us);
  if (widest_us_ >= candidate_us_) {
    agreed_ = 0;
  } else if (++agreed_ >= kRounds) {
    bound_us_ = candidate_us_;
    is_learnt_ = true;
    agreed_ = 0;
  }
}

}  // namespace armtrue::canopen
