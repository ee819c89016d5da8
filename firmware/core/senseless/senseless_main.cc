// senseless_tables FIRST COUNT [RECORDINGS]: runs COUNT senseless tables, from seed FIRST on, and
// writes them to the file RECORDINGS, if named, as recordings for cycle_replay. Stops with an error
// at the first table that breaks a requirement of senseless_run.h.
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <string>

#include "firmware/core/senseless/senseless_run.h"
#include "firmware/replay/replay.h"

namespace {

using namespace armtrue;

void append_bytes(tests::Bytes& to, const void* from, std::size_t size) {
  const std::size_t begin = to.size();
  to.resize(begin + size);
  std::memcpy(&to[begin], from, size);
}

// One recording: the table is activated and run, or refused in the only cycle.
bool record(std::FILE* file, std::uint64_t seed, bool accepted) {
  tests::SenselessImage made(seed);
  const std::vector<CycleInput> inputs = tests::senseless_inputs(made);
  tests::Bytes image = made.image();
  image.resize((image.size() + 3) / 4 * 4);
  const std::uint32_t cycles = accepted ? static_cast<std::uint32_t>(inputs.size()) : 1U;
  const replay::RecordingHead head = {
      replay::kMagic, made.joints(), 1000, cycles, static_cast<std::uint32_t>(image.size()), 0};
  tests::Bytes bytes;
  append_bytes(bytes, &head, sizeof head);
  append_bytes(bytes, image.data(), image.size());
  for (std::uint32_t i = 0; i < cycles; ++i) {
    replay::RecordedCycle cycle = {};
    const auto first = accepted ? replay::Request::kActivateA : replay::Request::kRefuseA;
    cycle.request = static_cast<std::uint32_t>(i == 0 ? first : replay::Request::kNone);
    std::copy(inputs[i].target.begin(), inputs[i].target.end(), cycle.target);
    std::copy(inputs[i].temperature_mdegc.begin(), inputs[i].temperature_mdegc.end(),
              cycle.temperature_mdegc);
    cycle.temperature_valid = inputs[i].temperature_valid;
    cycle.payload_g = inputs[i].payload_g;
    cycle.time_ms = static_cast<std::uint32_t>(inputs[i].time_ms);
    append_bytes(bytes, &cycle, sizeof cycle);
  }
  return std::fwrite(bytes.data(), 1, bytes.size(), file) == bytes.size();
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 3 && argc != 4) {
    std::fprintf(stderr, "usage: senseless_tables FIRST COUNT [RECORDINGS]\n");
    return 2;
  }
  const std::uint64_t first = std::strtoull(argv[1], nullptr, 10);
  const std::uint64_t count = std::strtoull(argv[2], nullptr, 10);
  std::FILE* file = argc == 4 ? std::fopen(argv[3], "wb") : nullptr;
  if (argc == 4 && file == nullptr) {
    std::fprintf(stderr, "senseless_tables: %s cannot be written\n", argv[3]);
    return 2;
  }
  std::uint64_t taken = 0;
  for (std::uint64_t seed = first; seed < first + count; ++seed) {
    const tests::SenselessRun run = tests::run_senseless(seed);
    if (!run.wrong.empty()) {
      std::fprintf(stderr, "seed %llu: %s\n", static_cast<unsigned long long>(seed),
                   run.wrong.c_str());
      return 1;
    }
    taken += run.accepted ? 1U : 0U;
    if (file != nullptr && !record(file, seed, run.accepted)) {
      std::fprintf(stderr, "senseless_tables: %s cannot be written\n", argv[3]);
      return 2;
    }
  }
  if (file != nullptr && std::fclose(file) != 0) return 2;
  std::printf("%llu senseless tables: %llu taken, %llu refused, none beyond the maxima\n",
              static_cast<unsigned long long>(count), static_cast<unsigned long long>(taken),
              static_cast<unsigned long long>(count - taken));
  return 0;
}
