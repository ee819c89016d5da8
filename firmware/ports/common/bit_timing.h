// Bit timing of a classic CAN controller (ISO 11898-1:2015, 11.3): the bit rate and the sample
// point from a clock.
#ifndef ARMTRUE_FIRMWARE_PORTS_COMMON_BIT_TIMING_H_
#define ARMTRUE_FIRMWARE_PORTS_COMMON_BIT_TIMING_H_

#include <cstdint>

namespace armtrue::ports {

// In time quanta; a bit is 1 + segment1 + segment2 quanta, sampled before segment2.
struct BitTiming {
  std::uint32_t prescaler = 0;  // 0: the clock does not divide into this bit rate
  std::uint32_t segment1 = 0;   // propagation and phase 1
  std::uint32_t segment2 = 0;
  std::uint32_t jump_width = 0;

  constexpr std::uint32_t quanta() const { return 1 + segment1 + segment2; }
  constexpr std::uint32_t sample_point_permille() const { return 1000 * (1 + segment1) / quanta(); }
};

// The timing with the sample point closest to 87.5 % (CiA 301, table 1), and among equals the one
// with the most quanta. Segment 1 up to 16, segment 2 up to 8 quanta, as bxCAN and the Zynq's
// controller have them. Exact rates only.
constexpr BitTiming bit_timing(std::uint32_t clock_hz, std::uint32_t bits_per_second) {
  constexpr std::uint32_t kWanted = 875;
  BitTiming best;
  std::uint32_t best_distance = UINT32_MAX;
  for (std::uint32_t quanta = 25; quanta >= 8; --quanta) {
    if (clock_hz % (bits_per_second * quanta) != 0) continue;
    const std::uint32_t prescaler = clock_hz / (bits_per_second * quanta);
    if (prescaler > 256) continue;
    for (std::uint32_t segment2 = 1; segment2 <= 8; ++segment2) {
      const std::uint32_t segment1 = quanta - 1 - segment2;
      if (segment1 < 1 || segment1 > 16) continue;
      const BitTiming timing{prescaler, segment1, segment2, segment2 < 4 ? segment2 : 4};
      const std::uint32_t sample = timing.sample_point_permille();
      const std::uint32_t distance = sample > kWanted ? sample - kWanted : kWanted - sample;
      if (distance < best_distance) {
        best_distance = distance;
        best = timing;
      }
    }
  }
  return best;
}

}  // namespace armtrue::ports

#endif  // ARMTRUE_FIRMWARE_PORTS_COMMON_BIT_TIMING_H_
