// canopen_soak [SECONDS [SEED [FAULTS_PER_THOUSAND [sync|async [inline|offset]]]]]: simulated
// motion with faults, as fast as it runs. Prints what happened; exit status 1 if the judge saw
// anything wrong.
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <cstring>

#include "firmware/testing/soak.h"

int main(int argc, char** argv) {
  using armtrue::canopen::Fault;
  const double seconds = argc > 1 ? std::atof(argv[1]) : 3600.0;
  const auto seed = static_cast<std::uint32_t>(argc > 2 ? std::atoi(argv[2]) : 1);
  const double rate = argc > 3 ? std::atof(argv[3]) : 1.0;
  const bool synchronous = argc > 4 && std::strcmp(argv[4], "sync") == 0;
  const bool offset = argc > 5 && std::strcmp(argv[5], "offset") == 0;
  const auto begin = std::chrono::steady_clock::now();
  using armtrue::canopen::Mode;
  armtrue::canopen::Soak soak(seed, rate, synchronous, offset ? Mode::kOffset : Mode::kInline);
  const std::string wrong = soak.run(static_cast<std::uint64_t>(1000.0 * seconds));
  const std::chrono::duration<double> took = std::chrono::steady_clock::now() - begin;
  const armtrue::canopen::SoakFigures& figures = soak.figures();
  std::printf(
      "%llu cycles of 1 ms in %.1f s, %s mode, seed %u, %g of each fault in 1000 cycles, %s "
      "targets\n",
      static_cast<unsigned long long>(figures.cycles), took.count(), offset ? "offset" : "inline",
      seed, rate, synchronous ? "synchronous" : "asynchronous");
  std::printf("%llu sets came out whole, %llu cut short by a full bus, the others withheld\n",
              static_cast<unsigned long long>(figures.outputs),
              static_cast<unsigned long long>(figures.partial));
  std::printf(
      "%llu actual positions came back exactly as commanded, %llu other frames bit-identical\n",
      static_cast<unsigned long long>(figures.feedback_checked),
      static_cast<unsigned long long>(figures.forwarded));
  unsigned long long faults = 0;
  for (const std::uint64_t count : figures.faults) faults += count;
  std::printf("%llu emergency messages; %llu faults:",
              static_cast<unsigned long long>(figures.emergencies), faults);
  for (std::size_t k = 0; k < armtrue::canopen::kFaults; ++k) {
    std::printf("%s %s %llu", k == 0 ? "" : ",", name_of(static_cast<Fault>(k)),
                static_cast<unsigned long long>(figures.faults[k]));
  }
  std::printf("\n%s\n", wrong.empty() ? "nothing wrong" : ("WRONG: " + wrong).c_str());
  return wrong.empty() ? 0 : 1;
}
