#include "firmware/canopen/motion/latency.h"

#include <algorithm>
#include <bit>
#include <numeric>

namespace armtrue::canopen {

std::size_t Latency::class_of(std::uint32_t value) {
  if (value < kFine) return value;
  const int power = std::bit_width(value) - 4;  // value >> power lies in 8 … 15
  const std::size_t number = kFine * static_cast<std::size_t>(power) + (value >> power);
  return std::min(number, kClasses - 1);
}

std::uint32_t Latency::end_of(std::size_t number) {
  if (number < 2 * kFine) return static_cast<std::uint32_t>(number);
  const auto power = static_cast<unsigned>(number / kFine - 1);
  return ((static_cast<std::uint32_t>(number % kFine + kFine) + 1U) << power) - 1U;
}

void Latency::note(std::uint32_t microseconds) {
  if (count_ == UINT32_MAX) return;
  ++count_;
  std::uint16_t& own = classes_[class_of(microseconds)];
  if (own == UINT16_MAX) {
    for (std::uint16_t& each : classes_) each = static_cast<std::uint16_t>(each / 2U);
  }
  ++own;
  least_ = std::min(least_, microseconds);
  most_ = std::max(most_, microseconds);
}

std::uint32_t Latency::quantile(std::uint32_t permille) const {
  const std::uint32_t all = std::accumulate(classes_.begin(), classes_.end(), 0U);
  const std::uint64_t wanted = (std::uint64_t{all} * permille + 999U) / 1000U;
  std::uint64_t below = 0;
  for (std::size_t k = 0; k < kClasses; ++k) {
    below += classes_[k];
    if (below < wanted || below == 0) continue;
    return k == kClasses - 1 ? most_ : std::min(end_of(k), most_);
  }
  return most_;
}

}  // namespace armtrue::canopen
