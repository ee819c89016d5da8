// Statistics of durations: minimum, median, 99.9 % and maximum from a histogram, without keeping
// every value.
#ifndef ARMTRUE_FIRMWARE_CANOPEN_MOTION_LATENCY_H_
#define ARMTRUE_FIRMWARE_CANOPEN_MOTION_LATENCY_H_

#include <array>
#include <cstddef>
#include <cstdint>

namespace armtrue::canopen {

class Latency {
 public:
  void note(std::uint32_t microseconds);

  std::uint32_t count() const { return count_; }
  std::uint32_t least() const { return count_ == 0 ? 0 : least_; }
  std::uint32_t most() const { return most_; }
  // The smallest value that `permille` thousandths of all do not exceed, rounded up to the end of
  // its class: within an eighth.
  std::uint32_t quantile(std::uint32_t permille) const;

 private:
  // Each value below 8 has its own class; above, every power of two has eight classes, up to 2^14.
  // The last class also takes all longer values.
  static constexpr std::size_t kFine = 8;
  static constexpr std::size_t kClasses = kFine * 12;
  static std::size_t class_of(std::uint32_t value);
  static std::uint32_t end_of(std::size_t number);

  // Relative frequencies, not counts: all are halved when one would exceed 16 bits.
  std::array<std::uint16_t, kClasses> classes_ = {};
  std::uint32_t count_ = 0;
  std::uint32_t least_ = UINT32_MAX;
  std::uint32_t most_ = 0;
};

}  // namespace armtrue::canopen

#endif  // ARMTRUE_FIRMWARE_CANOPEN_MOTION_LATENCY_H_
