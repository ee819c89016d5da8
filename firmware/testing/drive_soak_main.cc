// canopen_drive_soak [SECONDS [SEED [inline|offset]]]: simulated motion with drives that do not
// always follow, as fast as it runs. Prints what happened; exit status 1 if the judge saw anything
// wrong.
#include <cstdio>
#include <cstdlib>
#include <cstring>

#include "firmware/testing/drive_soak.h"

int main(int argc, char** argv) {
  using namespace armtrue::canopen;
  const double seconds = argc > 1 ? std::atof(argv[1]) : 3600.0;
  const auto seed = static_cast<std::uint32_t>(argc > 2 ? std::atoi(argv[2]) : 1);
  const bool offset = argc > 3 && std::strcmp(argv[3], "offset") == 0;
  DriveSoak soak(seed, offset ? Mode::kOffset : Mode::kInline);
  const std::string wrong = soak.run(static_cast<std::uint64_t>(1000.0 * seconds));
  const DriveSoakFigures& figures = soak.figures();
  const auto number = [](std::uint64_t value) { return static_cast<unsigned long long>(value); };
  std::printf("%llu cycles of 1 ms, %s mode, seed %u\n", number(figures.cycles),
              offset ? "offset" : "inline", seed);
  std::printf(
      "%llu sets judged, %llu with the whole correction; %llu turns of the axis without end\n",
      number(figures.outputs), number(figures.right), number(figures.wraps));
  std::printf("%llu corrections suspended, %llu came back\n", number(figures.suspended),
              number(figures.came_back));
  std::printf("largest step in shares of the permitted one: output %.3f, actual position %.3f\n",
              figures.largest_output_step, figures.largest_feedback_step);
  for (std::size_t k = 0; k < kDriveEvents; ++k) {
    std::printf("%s %s %llu", k == 0 ? "events:" : ",", name_of(static_cast<DriveEvent>(k)),
                number(figures.events[k]));
  }
  std::printf("\n%s\n", wrong.empty() ? "nothing wrong" : ("WRONG: " + wrong).c_str());
  return wrong.empty() ? 0 : 1;
}
