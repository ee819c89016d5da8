// Registers for the set-up of the chip (ST RM0090; section numbers beside each block). Peripherals
// with a driver of their own are reached through ports::RegisterBlock, so that a test can model
// them.
#ifndef ARMTRUE_FIRMWARE_PORTS_STM32F405_REGISTERS_H_
#define ARMTRUE_FIRMWARE_PORTS_STM32F405_REGISTERS_H_

#include <cstdint>

namespace armtrue::stm32f405 {

using Register = volatile std::uint32_t;

struct RccRegisters {  // 7.3
  Register cr, pllcfgr, cfgr, cir, ahb1rstr, ahb2rstr, ahb3rstr, reserved0, apb1rstr, apb2rstr,
      reserved1[2];
  Register ahb1enr, ahb2enr, ahb3enr, reserved2, apb1enr, apb2enr, reserved3[2];
  Register ahb1lpenr, ahb2lpenr, ahb3lpenr, reserved4, apb1lpenr, apb2lpenr, reserved5[2];
  Register bdcr, csr;
};

struct FlashInterfaceRegisters {  // 3.9; flash_driver.h erases and programs
  Register acr;
};

struct PwrRegisters {  // 5.4
  Register cr, csr;
};

struct GpioRegisters {  // 8.4
  Register moder, otyper, ospeedr, pupdr, idr, odr, bsrr, lckr, afr[2];
};

struct TimerRegisters {  // 18.4 (TIM2, 32 bits)
  Register cr1, cr2, smcr, dier, sr, egr, ccmr1, ccmr2, ccer, cnt, psc, arr;
};

struct SysTickRegisters {  // PM0214 4.5
  Register ctrl, load, val, calib;
};

inline RccRegisters& rcc() { return *reinterpret_cast<RccRegisters*>(0x40023800); }
inline FlashInterfaceRegisters& flash_interface() {
  return *reinterpret_cast<FlashInterfaceRegisters*>(0x40023C00);
}
inline PwrRegisters& pwr() { return *reinterpret_cast<PwrRegisters*>(0x40007000); }
inline GpioRegisters& gpio_a() { return *reinterpret_cast<GpioRegisters*>(0x40020000); }
inline GpioRegisters& gpio_b() { return *reinterpret_cast<GpioRegisters*>(0x40020400); }
inline TimerRegisters& tim2() { return *reinterpret_cast<TimerRegisters*>(0x40000000); }
inline SysTickRegisters& systick() { return *reinterpret_cast<SysTickRegisters*>(0xE000E010); }

}  // namespace armtrue::stm32f405

#endif  // ARMTRUE_FIRMWARE_PORTS_STM32F405_REGISTERS_H_
