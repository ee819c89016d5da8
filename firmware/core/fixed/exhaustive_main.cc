// The sine at every binary angle and the reciprocal at every argument, against double precision:
// `./dev bench accuracy`.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <thread>
#include <vector>

#include "firmware/core/fixed/angle.h"
#include "firmware/core/fixed/fixed.h"

namespace {

constexpr double kSineBound = 2.0e-9;                   // as angle.h states it
constexpr double kReciprocalBound = 1.0 / (1UL << 29);  // as fixed.h states it

double sine_error(std::uint64_t raw) {
  const double exact =
      std::sin(std::ldexp(static_cast<double>(static_cast<std::int32_t>(raw)), -32) * 2.0 * M_PI);
  return std::abs(
      std::ldexp(armtrue::sine({static_cast<std::uint32_t>(raw)}).raw, -armtrue::Ratio::fraction) -
      exact);
}

double reciprocal_error(std::uint64_t d) {
  const armtrue::Reciprocal r = armtrue::reciprocal(static_cast<std::uint32_t>(d));
  return std::abs(
      std::ldexp(static_cast<double>(r.mantissa), r.exponent - 62) * static_cast<double>(d) - 1.0);
}

// The largest error over begin … end, computed on all processors.
template <typename Error>
double worst_of(std::uint64_t begin, std::uint64_t end, Error error) {
  const std::uint64_t parts = std::max(1U, std::thread::hardware_concurrency());
  std::vector<double> worst(parts);
  std::vector<std::thread> threads;
  for (std::uint64_t part = 0; part < parts; ++part) {
    threads.emplace_back([&worst, begin, end, parts, part, error] {
      double largest = 0.0;
      for (std::uint64_t x = begin + part; x < end; x += parts) {
        largest = std::max(largest, error(x));
      }
      worst[part] = largest;
    });
  }
  for (std::thread& thread : threads) thread.join();
  return *std::max_element(worst.begin(), worst.end());
}

}  // namespace

int main() {
  const double sine = worst_of(0, std::uint64_t{1} << 32, sine_error);
  std::printf("sine, all 2^32 angles: largest error %.3e (bound %.1e)\n", sine, kSineBound);
  const double reciprocal = worst_of(1, (std::uint64_t{1} << 31) + 1, reciprocal_error);
  std::printf("reciprocal, 1 to 2^31: largest relative error %.3e (bound %.3e)\n", reciprocal,
              kReciprocalBound);
  return sine < kSineBound && reciprocal < kReciprocalBound ? 0 : 1;
}
