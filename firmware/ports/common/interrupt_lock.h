// Disables interrupts for the lifetime of the object. Does nothing on the host, where drivers are
// tested in one thread.
#ifndef ARMTRUE_FIRMWARE_PORTS_COMMON_INTERRUPT_LOCK_H_
#define ARMTRUE_FIRMWARE_PORTS_COMMON_INTERRUPT_LOCK_H_

#include <cstdint>

namespace armtrue::ports {

class InterruptLock {
 public:
#if defined(__arm__) && __ARM_ARCH_PROFILE == 'M'
  // cppcheck-suppress uninitMemberVar; by the instruction
  InterruptLock() { asm volatile("mrs %0, primask\n cpsid i" : "=r"(before_) : : "memory"); }
  ~InterruptLock() { asm volatile("msr primask, %0" : : "r"(before_) : "memory"); }
#elif defined(__arm__)
  // cppcheck-suppress uninitMemberVar; by the instruction
  InterruptLock() { asm volatile("mrs %0, cpsr\n cpsid i" : "=r"(before_) : : "memory"); }
  ~InterruptLock() { asm volatile("msr cpsr_c, %0" : : "r"(before_) : "memory"); }
#else
  InterruptLock() {}
  ~InterruptLock() {}
#endif
  InterruptLock(const InterruptLock&) = delete;
  InterruptLock& operator=(const InterruptLock&) = delete;

#if defined(__arm__)
 private:
  std::uint32_t before_;
#endif
};

}  // namespace armtrue::ports

#endif  // ARMTRUE_FIRMWARE_PORTS_COMMON_INTERRUPT_LOCK_H_
