#include "firmware/ports/stm32f405/system.h"

#include <initializer_list>

#include "firmware/ports/common/interrupt_lock.h"
#include "firmware/ports/common/register_block.h"
#include "firmware/ports/stm32f405/free_running_clock.h"
#include "firmware/ports/stm32f405/registers.h"

namespace {

volatile bool is_awake = false;

armtrue::ports::MappedRegisters tim2_registers(0x40000000);
armtrue::stm32f405::FreeRunningClock device_clock(tim2_registers);

}  // namespace

extern "C" void systick_handler() { is_awake = true; }

namespace armtrue::stm32f405 {
namespace {

constexpr std::uint32_t kTicksPerMs = kCoreHz / 1000;
// Timers on a divided bus run at twice its clock (7.2), in QEMU at 1 GHz.
constexpr std::uint32_t kTim2Hz = 2 * kApb1Hz;
constexpr std::uint32_t kEmulatedTim2Hz = 1'000'000'000;
constexpr std::uint32_t kPolls = 100'000;  // some ten milliseconds at 16 MHz; a crystal needs two

// RCC (RM0090, 7.3).
constexpr std::uint32_t kCrHseOn = 1U << 16;
constexpr std::uint32_t kCrHseReady = 1U << 17;
constexpr std::uint32_t kCrPllOn = 1U << 24;
constexpr std::uint32_t kCrPllReady = 1U << 25;
constexpr std::uint32_t kPllFromHse = 1U << 22;
constexpr std::uint32_t kInternalHz = 16'000'000;
constexpr std::uint32_t kPllInputHz = 2'000'000;
constexpr std::uint32_t kPllMultiplier = 168;  // to 336 MHz, halved for the core
constexpr std::uint32_t kPllUsbDivider = 7;
constexpr std::uint32_t kCfgrPll = 2U;
constexpr std::uint32_t kCfgrApb1By4 = 5U << 10;
constexpr std::uint32_t kCfgrApb2By2 = 4U << 13;
static_assert(ARMTRUE_HSE_HZ % kPllInputHz == 0 && ARMTRUE_HSE_HZ >= 4'000'000 &&
              ARMTRUE_HSE_HZ <= 26'000'000);

bool wait(Register& reg, std::uint32_t mask, std::uint32_t value) {
  for (std::uint32_t i = 0; i < kPolls; ++i) {
    if ((reg & mask) == value) return true;
  }
  return false;
}

bool start_pll(std::uint32_t input_hz, std::uint32_t source) {
  rcc().pllcfgr =
      (kPllUsbDivider << 24) | source | (kPllMultiplier << 6) | (input_hz / kPllInputHz);
  rcc().cr = rcc().cr | kCrPllOn;
  return wait(rcc().cr, kCrPllReady, kCrPllReady);
}

void set_alternate(GpioRegisters& gpio, std::uint32_t pin, std::uint32_t function) {
  const std::uint32_t pair = 2 * pin;
  const std::uint32_t nibble = 4 * (pin % 8);
  gpio.afr[pin / 8] = (gpio.afr[pin / 8] & ~(0xFU << nibble)) | (function << nibble);
  gpio.ospeedr = gpio.ospeedr | (2U << pair);
  gpio.pupdr = (gpio.pupdr & ~(3U << pair)) | (1U << pair);  // pull-up: recessive, idle
  gpio.moder = (gpio.moder & ~(3U << pair)) | (2U << pair);
}

}  // namespace

ClockSource start_clocks() {
  rcc().apb1enr = rcc().apb1enr | (1U << 0) | (1U << 28);  // TIM2, power controller
  pwr().cr = pwr().cr | (1U << 14);                        // full voltage for 168 MHz
  // Five wait states at 168 MHz and 3.3 V (table 10), prefetch and both caches.
  flash_interface().acr = 5U | (1U << 8) | (1U << 9) | (1U << 10);

  rcc().cr = rcc().cr | kCrHseOn;
  const bool crystal = wait(rcc().cr, kCrHseReady, kCrHseReady);
  const bool locked = crystal ? start_pll(ARMTRUE_HSE_HZ, kPllFromHse) : start_pll(kInternalHz, 0);
  if (locked) {
    rcc().cfgr = kCfgrApb1By4 | kCfgrApb2By2 | kCfgrPll;
    wait(rcc().cfgr, 3U << 2, kCfgrPll << 2);
  }

  device_clock.start(locked ? kTim2Hz : kEmulatedTim2Hz);
  systick().load = kTicksPerMs - 1;
  systick().val = 0;
  systick().ctrl = 7;  // core clock, interrupt, on
  if (!locked) return ClockSource::kEmulated;
  return crystal ? ClockSource::kCrystal : ClockSource::kInternal;
}

std::uint64_t clock_us() { return device_clock.now_us(); }

void start_pins() {
  rcc().ahb1enr = rcc().ahb1enr | (1U << 0) | (1U << 1);                 // GPIO A, B
  rcc().apb1enr = rcc().apb1enr | (1U << 17) | (1U << 25) | (1U << 26);  // USART2, CAN1, CAN2
  rcc().apb2enr = rcc().apb2enr | (1U << 4) | (1U << 14);                // USART1, SYSCFG (EXTI)
  gpio_b().pupdr =
      gpio_b().pupdr | (2U << (2 * 2));  // BOOT1 reads low on a board without the jumper
  show_health(false);
  gpio_b().moder = (gpio_b().moder & ~3U) | 1U;  // PB0 is an output
  constexpr std::uint32_t kUsartFunction = 7;
  constexpr std::uint32_t kCanFunction = 9;
  for (const std::uint32_t pin : {2U, 3U, 9U, 10U}) set_alternate(gpio_a(), pin, kUsartFunction);
  for (const std::uint32_t pin : {8U, 9U, 12U, 13U}) set_alternate(gpio_b(), pin, kCanFunction);
}

// One enable bit per interrupt (PM0214, 4.3).
void enable_interrupt(std::uint32_t number) {
  reinterpret_cast<Register*>(0xE000E100)[number / 32] = 1U << (number % 32);
}

bool serial_is_requested() { return (gpio_b().idr & (1U << 2)) != 0; }

void wake() { is_awake = true; }

void sleep() {
  // A pending interrupt ends WFI even while interrupts are locked out, so that none is missed
  // between the test and WFI.
  const ports::InterruptLock lock;
  if (!is_awake) asm volatile("wfi" : : : "memory");
  is_awake = false;
}

void show_health(bool is_sound) { gpio_b().bsrr = is_sound ? 1U << 0 : 1U << 16; }

}  // namespace armtrue::stm32f405
