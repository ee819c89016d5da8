#include "firmware/ports/arm/semihosting.h"

#include <cstring>

namespace armtrue::semihosting {
namespace {

enum class Operation : std::uint32_t {
  kOpen = 0x01,
  kClose = 0x02,
  kWriteString = 0x04,
  kWrite = 0x05,
  kRead = 0x06,
  kGetCommandLine = 0x15,
  kExitExtended = 0x20,
};

enum class OpenMode : std::uint32_t { kReadBinary = 1, kWriteBinary = 5 };

constexpr std::uintptr_t kApplicationExit = 0x20026;  // ADP_Stopped_ApplicationExit

std::uintptr_t call(Operation operation, std::uintptr_t argument) {
  register std::uintptr_t r0 asm("r0") = static_cast<std::uintptr_t>(operation);
  register std::uintptr_t r1 asm("r1") = argument;
#if defined(__ARM_ARCH_PROFILE) && __ARM_ARCH_PROFILE == 'M'
  asm volatile("bkpt 0xab" : "+r"(r0) : "r"(r1) : "memory");
#else
  asm volatile("svc 0xab" : "+r"(r0) : "r"(r1) : "memory", "lr");
#endif
  return r0;
}

std::uintptr_t call(Operation operation, const std::uintptr_t* block) {
  return call(operation, reinterpret_cast<std::uintptr_t>(block));
}

// A handle, or -1 where the host refused. `path` is relative to the emulator's working directory.
std::int32_t open(const char* path, OpenMode mode) {
  const std::uintptr_t block[] = {reinterpret_cast<std::uintptr_t>(path),
                                  static_cast<std::uintptr_t>(mode), std::strlen(path)};
  return static_cast<std::int32_t>(call(Operation::kOpen, block));
}

}  // namespace

void close(std::int32_t handle) {
  const std::uintptr_t block[] = {static_cast<std::uintptr_t>(handle)};
  call(Operation::kClose, block);
}

std::size_t read(std::int32_t handle, void* data, std::size_t size) {
  const std::uintptr_t block[] = {static_cast<std::uintptr_t>(handle),
                                  reinterpret_cast<std::uintptr_t>(data), size};
  const std::uintptr_t missing = call(Operation::kRead, block);
  return missing <= size ? size - missing : 0;
}

bool write(std::int32_t handle, const void* data, std::size_t size) {
  const std::uintptr_t block[] = {static_cast<std::uintptr_t>(handle),
                                  reinterpret_cast<std::uintptr_t>(data), size};
  return call(Operation::kWrite, block) == 0;
}

void print(const char* text) {
  call(Operation::kWriteString, reinterpret_cast<std::uintptr_t>(text));
}

void print_unsigned(std::uint32_t value) {
  char text[11];
  std::size_t at = sizeof text - 1;
  text[at] = '\0';
  do {
    text[--at] = static_cast<char>('0' + value % 10);
    value /= 10;
  } while (value != 0);
  print(&text[at]);
}

bool open_files(std::int32_t& input, std::int32_t& output) {
  char text[256];
  std::uintptr_t block[] = {reinterpret_cast<std::uintptr_t>(text), sizeof text};
  if (call(Operation::kGetCommandLine, block) != 0 || block[1] >= sizeof text) return false;
  char* space = std::strchr(text, ' ');
  if (space == nullptr) return false;
  *space = '\0';
  input = open(text, OpenMode::kReadBinary);
  output = open(space + 1, OpenMode::kWriteBinary);
  return input >= 0 && output >= 0;
}

void exit(std::uint32_t status) {
  const std::uintptr_t block[] = {kApplicationExit, status};
  for (;;) call(Operation::kExitExtended, block);
}

}  // namespace armtrue::semihosting
