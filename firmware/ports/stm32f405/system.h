// Clocks, time and pins of the STM32F405.
#ifndef ARMTRUE_FIRMWARE_PORTS_STM32F405_SYSTEM_H_
#define ARMTRUE_FIRMWARE_PORTS_STM32F405_SYSTEM_H_

#include <cstdint>

namespace armtrue::stm32f405 {

inline constexpr std::uint32_t kCoreHz = 168'000'000;
inline constexpr std::uint32_t kApb1Hz = kCoreHz / 4;  // CAN, USART2
inline constexpr std::uint32_t kApb2Hz = kCoreHz / 2;  // USART1

enum class ClockSource : std::uint8_t {
  kCrystal,   // accurate enough for CAN at 1 Mbit/s
  kInternal,  // 1 %: serial ports only
  kEmulated,  // no clock controller answers
};

// Brings the core to 168 MHz from the crystal (ARMTRUE_HSE_HZ), else from the internal oscillator,
// and starts the clock and the tick that wakes the core every millisecond.
ClockSource start_clocks();

// Microseconds since start_clocks(), never decreasing; counts on during the erase of a flash
// sector. Must not be called from interrupts.
std::uint64_t clock_us();

// Routes CAN1 to PB8/PB9, CAN2 to PB12/PB13, USART1 to PA9/PA10, USART2 to PA2/PA3, and powers
// them.
void start_pins();

// Enables an interrupt in the nested vectored interrupt controller; its number as in RM0090,
// table 62.
void enable_interrupt(std::uint32_t number);

// Whether the jumper BOOT1 (PB2) asks for the serial ports instead of CAN.
bool serial_is_requested();

// Makes the next sleep() return at once. Called by every interrupt handler.
void wake();

// Stops the core until an interrupt comes; returns at once if one has come since the last call. The
// millisecond tick is one.
void sleep();

// Sets the output PB0, which holds the bypass relay of docs/installation.md: high while the joint
// path is sound. A reset or a loss of power sets it low.
void show_health(bool is_sound);

}  // namespace armtrue::stm32f405

#endif  // ARMTRUE_FIRMWARE_PORTS_STM32F405_SYSTEM_H_
