// The few symbols that compiled C++ expects and that the image supplies itself instead of linking
// libstdc++ or newlib, whose versions are three times as large.
#include <cstddef>
#include <cstdint>

extern "C" {

// Called through a table slot of an abstract class; reached only by a programming error.
[[noreturn]] void fault_handler();
[[noreturn]] void __cxa_pure_virtual() { fault_handler(); }

// Objects with static storage are never destroyed: the image does not end.
void* __dso_handle = nullptr;
int __aeabi_atexit(void*, void (*)(void*), void*) { return 0; }

// Whole words where both ends lie on words, else bytes. (This file is compiled so that no loop
// becomes a call of the function that it is in.)
static bool on_words(const void* a, const void* b) {
  return ((reinterpret_cast<std::uintptr_t>(a) | reinterpret_cast<std::uintptr_t>(b)) & 3U) == 0U;
}

void* memcpy(void* to, const void* from, std::size_t size) {
  auto* out = static_cast<std::uint8_t*>(to);
  const auto* in = static_cast<const std::uint8_t*>(from);
  std::size_t i = 0;
  if (on_words(to, from)) {
    auto* words = static_cast<std::uint32_t*>(to);
    const auto* source = static_cast<const std::uint32_t*>(from);
    for (; i + 16U <= size; i += 16U) {
      const std::uint32_t first = *source++;
      const std::uint32_t second = *source++;
      const std::uint32_t third = *source++;
      const std::uint32_t fourth = *source++;
      *words++ = first;
      *words++ = second;
      *words++ = third;
      *words++ = fourth;
    }
    for (; i + 4U <= size; i += 4U) *words++ = *source++;
  }
  for (; i < size; ++i) out[i] = in[i];
  return to;
}

void* memmove(void* to, const void* from, std::size_t size) {
  auto* out = static_cast<std::uint8_t*>(to);
  const auto* in = static_cast<const std::uint8_t*>(from);
  if (out <= in || out >= in + size) return memcpy(to, from, size);
  while (size-- != 0U) out[size] = in[size];
  return to;
}

void* memset(void* to, int value, std::size_t size) {
  auto* out = static_cast<std::uint8_t*>(to);
  const auto byte = static_cast<std::uint8_t>(value);
  std::size_t i = 0;
  if (on_words(to, nullptr)) {
    auto* words = static_cast<std::uint32_t*>(to);
    const std::uint32_t word = byte * 0x01010101U;
    for (; i + 16U <= size; i += 16U) {
      *words++ = word;
      *words++ = word;
      *words++ = word;
      *words++ = word;
    }
    for (; i + 4U <= size; i += 4U) *words++ = word;
  }
  for (; i < size; ++i) out[i] = byte;
  return to;
}

int memcmp(const void* a, const void* b, std::size_t size) {
  const auto* first = static_cast<const std::uint8_t*>(a);
  const auto* second = static_cast<const std::uint8_t*>(b);
  for (std::size_t i = 0; i < size; ++i) {
    if (first[i] != second[i]) return first[i] - second[i];
  }
  return 0;
}
}
