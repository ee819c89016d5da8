// Test image: shows that an operation which the protection of the STM32F405 image forbids ends in a
// reset, and that its cause and place are known afterwards. Command line: INPUT OUTPUT. The first
// byte of INPUT selects the forbidden operation of the first start. The second start writes OUTPUT:
// reset cause, whether the memory protection was on, starts since power-on, address of the
// instruction, fault status, fault address.
#include <cstdint>

#include "firmware/ports/arm/semihosting.h"
#include "firmware/ports/stm32f405/protection.h"

namespace {

using namespace armtrue;

extern "C" std::uint32_t _stack_limit;

// An instruction that returns (bx lr), to be executed from RAM.
alignas(4) std::uint16_t code_in_ram[] = {0x4770};

// Hides the address from the compiler.
[[gnu::noinline]] volatile std::uint32_t* pointer_to(std::uintptr_t address) {
  asm volatile("" : "+r"(address));
  return reinterpret_cast<volatile std::uint32_t*>(address);
}

[[gnu::naked]] void fill_the_stack() { asm volatile("1: push {r0-r7}\n b 1b"); }

void do_wrong(std::uint8_t what) {
  switch (what) {
    case 'n':
      *pointer_to(4) = 1;
      break;
    case 'r':
      (void)*pointer_to(0);
      break;
    case 'x':
      reinterpret_cast<void (*)()>(reinterpret_cast<std::uintptr_t>(code_in_ram) | 1U)();
      break;
    case 's':
      fill_the_stack();
      break;
    case 'g':
      *pointer_to(reinterpret_cast<std::uintptr_t>(&_stack_limit) - 4) = 1;
      break;
    case 'i':
      *pointer_to(0x08000400) = 0;
      break;
    case 'u':
      asm volatile("udf #0");
      break;
    case 'm':
      stm32f405::restart(ports::ResetCause::kNmt);
    default:
      break;
  }
}

}  // namespace

int main() {
  const bool is_protected = stm32f405::start_protection();
  std::int32_t input = 0;
  std::int32_t output = 0;
  if (!semihosting::open_files(input, output)) semihosting::exit(1);

  const ports::ResetLog& log = stm32f405::reset_log();
  if (log.resets() < 2) {
    std::uint8_t what = 0;
    if (semihosting::read(input, &what, 1) != 1) semihosting::exit(2);
    do_wrong(what);
    semihosting::exit(3);  // the operation did not cause a reset
  }
  const std::uint32_t result[] = {static_cast<std::uint32_t>(log.cause()),
                                  static_cast<std::uint32_t>(is_protected),
                                  log.resets(),
                                  log.fault().instruction,
                                  log.fault().status,
                                  log.fault().address};
  semihosting::exit(semihosting::write(output, result, sizeof result) ? 0 : 4);
}
