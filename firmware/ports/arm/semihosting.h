// ARM semihosting: how a test image running in an emulator reads a recorded input, writes its
// output and ends with an exit status. The product images never use it: without a debugger the BKPT
// that carries a request is a fault.
//
// Source: Arm "Semihosting for AArch32 and AArch64", 2.0.
#ifndef ARMTRUE_FIRMWARE_PORTS_ARM_SEMIHOSTING_H_
#define ARMTRUE_FIRMWARE_PORTS_ARM_SEMIHOSTING_H_

#include <cstddef>
#include <cstdint>

namespace armtrue::semihosting {

// Opens the two files named on the emulator's command line (`arg=` of -semihosting-config): INPUT
// OUTPUT. False if a name is missing or the host cannot open a file.
bool open_files(std::int32_t& input, std::int32_t& output);

void close(std::int32_t handle);

// Reads up to `size` bytes; returns the number read (less than `size` only at the end of the file).
std::size_t read(std::int32_t handle, void* data, std::size_t size);

// Returns true where every byte was written.
bool write(std::int32_t handle, const void* data, std::size_t size);

// Prints a nul-terminated string on the emulator's standard error.
void print(const char* text);

// Prints an unsigned number in decimal.
void print_unsigned(std::uint32_t value);

// Ends the emulator; `status` is its exit status (0 to 255).
[[noreturn]] void exit(std::uint32_t status);

}  // namespace armtrue::semihosting

#endif  // ARMTRUE_FIRMWARE_PORTS_ARM_SEMIHOSTING_H_
