// Access of a driver to its registers. A test substitutes a model of the peripheral.
#ifndef ARMTRUE_FIRMWARE_PORTS_COMMON_REGISTER_BLOCK_H_
#define ARMTRUE_FIRMWARE_PORTS_COMMON_REGISTER_BLOCK_H_

#include <concepts>
#include <cstdint>

namespace armtrue::ports {

// 32-bit registers at byte offsets from a base. Drivers are templates over this, so on the target
// an access is one load or store.
template <typename T>
concept RegisterBlock = requires(T block, const T constant, std::uint32_t value) {
  { constant.read(value) } -> std::same_as<std::uint32_t>;
  block.write(value, value);
};

// Memory-mapped registers of a real peripheral.
class MappedRegisters {
 public:
  constexpr explicit MappedRegisters(std::uintptr_t base) : base_(base) {}

  std::uint32_t read(std::uint32_t offset) const {
    return *reinterpret_cast<const volatile std::uint32_t*>(base_ + offset);
  }
  void write(std::uint32_t offset, std::uint32_t value) {
    *reinterpret_cast<volatile std::uint32_t*>(base_ + offset) = value;
  }

 private:
  std::uintptr_t base_;
};

template <RegisterBlock Registers>
void set_bits(Registers& registers, std::uint32_t offset, std::uint32_t bits) {
  registers.write(offset, registers.read(offset) | bits);
}

template <RegisterBlock Registers>
void clear_bits(Registers& registers, std::uint32_t offset, std::uint32_t bits) {
  registers.write(offset, registers.read(offset) & ~bits);
}

// Waits until `(register & mask) == value`; false after `polls` readings.
template <RegisterBlock Registers>
bool wait_for(const Registers& registers, std::uint32_t offset, std::uint32_t mask,
              std::uint32_t value, std::uint32_t polls) {
  for (std::uint32_t i = 0; i < polls; ++i) {
    if ((registers.read(offset) & mask) == value) return true;
  }
  return false;
}

}  // namespace armtrue::ports

#endif  // ARMTRUE_FIRMWARE_PORTS_COMMON_REGISTER_BLOCK_H_
