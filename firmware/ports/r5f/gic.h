// The interrupt controller of the real-time unit: Arm PL390, a GIC of architecture version 1 (Arm
// IHI 0048).
#ifndef ARMTRUE_FIRMWARE_PORTS_R5F_GIC_H_
#define ARMTRUE_FIRMWARE_PORTS_R5F_GIC_H_

#include <cstdint>

#include "firmware/ports/common/register_block.h"

namespace armtrue::r5f {

namespace gic {

// Distributor.
inline constexpr std::uint32_t kDistributorControl = 0x000;
inline constexpr std::uint32_t kType = 0x004;
inline constexpr std::uint32_t kSetEnable = 0x100;
inline constexpr std::uint32_t kClearEnable = 0x180;
inline constexpr std::uint32_t kPriority = 0x400;
inline constexpr std::uint32_t kTargets = 0x800;
// Interface of the processor.
inline constexpr std::uint32_t kInterfaceControl = 0x00;
inline constexpr std::uint32_t kPriorityMask = 0x04;
inline constexpr std::uint32_t kAcknowledge = 0x0C;
inline constexpr std::uint32_t kEndOfInterrupt = 0x10;

inline constexpr std::uint32_t kSpurious = 1020;  // and above
inline constexpr std::uint32_t kNumberMask = 0x3FF;

}  // namespace gic

template <ports::RegisterBlock Registers>
class Gic {
 public:
  Gic(Registers& distributor, Registers& interface)
      : distributor_(distributor), interface_(interface) {}

  // Whether the controller exists: every implementation has at least one line of 32 interrupts, and
  // its type register states the number.
  bool is_present() const { return distributor_.read(gic::kType) != 0; }

  // Disables every interrupt and lets the processor take those that are enabled later.
  void start() {
    const std::uint32_t lines = (distributor_.read(gic::kType) & 0x1FU) + 1;
    distributor_.write(gic::kDistributorControl, 0);
    for (std::uint32_t i = 0; i < lines; ++i) {
      distributor_.write(gic::kClearEnable + 4 * i, 0xFFFFFFFF);
    }
    distributor_.write(gic::kDistributorControl, 1);
    interface_.write(gic::kPriorityMask, 0xFF);
    interface_.write(gic::kInterfaceControl, 1);
  }

  // Routes a shared peripheral interrupt (number as in UG1085, table 13-1) to this processor. All
  // have the same priority, so that none preempts another.
  void enable(std::uint32_t number) {
    constexpr std::uint32_t kMiddlePriority = 0xA0;
    constexpr std::uint32_t kThisProcessor = 1;
    set_byte(gic::kPriority, number, kMiddlePriority);
    set_byte(gic::kTargets, number, kThisProcessor);
    distributor_.write(gic::kSetEnable + 4 * (number / 32), 1U << (number % 32));
  }

  // Acknowledges pending interrupts and calls `handle(number)` for each, until there is none.
  template <typename Handle>
  void serve(Handle handle) {
    for (;;) {
      const std::uint32_t acknowledged = interface_.read(gic::kAcknowledge);
      const std::uint32_t number = acknowledged & gic::kNumberMask;
      if (number >= gic::kSpurious) return;
      handle(number);
      interface_.write(gic::kEndOfInterrupt, acknowledged);
    }
  }

 private:
  void set_byte(std::uint32_t offset, std::uint32_t number, std::uint32_t value) {
    const std::uint32_t at = offset + number / 4 * 4;
    const std::uint32_t shift = 8 * (number % 4);
    distributor_.write(at, (distributor_.read(at) & ~(0xFFU << shift)) | (value << shift));
  }

  Registers& distributor_;
  Registers& interface_;
};

}  // namespace armtrue::r5f

#endif  // ARMTRUE_FIRMWARE_PORTS_R5F_GIC_H_
