// Test image: plays a recording on the emulated chip and counts the instructions of every cycle.
// Command line: RECORDING RESULT, two host files.
#include "firmware/ports/arm/instruction_counter.h"
#include "firmware/ports/arm/semihosting.h"
#include "firmware/replay/replay.h"

namespace {

namespace semihosting = armtrue::semihosting;
using armtrue::ports::InstructionCounter;

bool read_file(void* handle, void* data, std::size_t size) {
  return semihosting::read(*static_cast<std::int32_t*>(handle), data, size) == size;
}

bool write_file(void* handle, const void* data, std::size_t size) {
  return semihosting::write(*static_cast<std::int32_t*>(handle), data, size);
}

std::uint32_t between(const void* counter, std::uint32_t before, std::uint32_t after) {
  return static_cast<const InstructionCounter*>(counter)->between(before, after);
}

armtrue::replay::Player player;

}  // namespace

int main() {
  constexpr std::uint32_t kBadCommandLine = 9;
  std::int32_t input = 0;
  std::int32_t output = 0;
  if (!semihosting::open_files(input, output)) semihosting::exit(kBadCommandLine);
  const InstructionCounter counter;
  const armtrue::replay::Outcome outcome =
      armtrue::replay::play_all(player, {&read_file, &input}, {&write_file, &output},
                                {&InstructionCounter::read, &between, &counter});
  semihosting::close(output);
  semihosting::exit(static_cast<std::uint32_t>(outcome));
}
