// Test image: shows that the emulated board starts, runs constructors, takes a recorded input and
// gives an output, and that instruction counts are exact. Command line: INPUT OUTPUT, two host
// files; every byte of INPUT is written to OUTPUT plus one. Prints the count of a loop whose length
// is known.
#include <cstddef>
#include <cstdint>

#include "firmware/ports/arm/instruction_counter.h"
#include "firmware/ports/arm/semihosting.h"

namespace {

namespace semihosting = armtrue::semihosting;

constexpr std::uint32_t kLoops = 1000;

struct ConstructorProbe {
  ConstructorProbe() { value = 0x600DF00D; }
  volatile std::uint32_t value;
};
ConstructorProbe constructor_probe;

// Two instructions per iteration (SUBS, BNE), independent of the compiler.
void count_down(std::uint32_t turns) {
  asm volatile("1: subs %0, %0, #1\n bne 1b" : "+r"(turns) : : "cc");
}

bool shift_file(std::int32_t input, std::int32_t output) {
  std::uint8_t block[256];
  std::size_t size = 0;
  while ((size = semihosting::read(input, block, sizeof block)) > 0) {
    for (std::size_t i = 0; i < size; ++i) block[i] = static_cast<std::uint8_t>(block[i] + 1);
    if (!semihosting::write(output, block, size)) return false;
  }
  semihosting::close(input);
  semihosting::close(output);
  return true;
}

}  // namespace

int main() {
  using armtrue::ports::InstructionCounter;
  if (constructor_probe.value != 0x600DF00D) semihosting::exit(1);

  const InstructionCounter counter;
  const std::uint32_t before = InstructionCounter::read();
  count_down(kLoops);
  const std::uint32_t after = InstructionCounter::read();
  semihosting::print_unsigned(counter.between(before, after));
  semihosting::print("\n");

  std::int32_t input = 0;
  std::int32_t output = 0;
  if (!semihosting::open_files(input, output)) semihosting::exit(2);
  semihosting::exit(shift_file(input, output) ? 0 : 3);
}
