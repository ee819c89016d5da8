// cycle_replay RECORDING RESULT: plays a recording on the host.
#include <cstdio>
#include <memory>

#include "firmware/replay/replay.h"

namespace {

bool read_file(void* file, void* data, std::size_t size) {
  return std::fread(data, 1, size, static_cast<std::FILE*>(file)) == size;
}

bool write_file(void* file, const void* data, std::size_t size) {
  return std::fwrite(data, 1, size, static_cast<std::FILE*>(file)) == size;
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 3) {
    std::fprintf(stderr, "usage: cycle_replay RECORDING RESULT\n");
    return 2;
  }
  std::FILE* input = std::fopen(argv[1], "rb");
  std::FILE* output = std::fopen(argv[2], "wb");
  if (input == nullptr || output == nullptr) {
    std::fprintf(stderr, "cycle_replay: cannot open %s\n", input == nullptr ? argv[1] : argv[2]);
    return 2;
  }
  const auto player = std::make_unique<armtrue::replay::Player>();
  const armtrue::replay::Outcome outcome = armtrue::replay::play_all(
      *player, {&read_file, input}, {&write_file, output}, {nullptr, nullptr, nullptr});
  std::fclose(input);
  return std::fclose(output) == 0 ? static_cast<int>(outcome) : 3;
}
