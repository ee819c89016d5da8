// The few symbols that compiled C++ expects and that the image supplies itself instead of linking
// libstdc++ or newlib, whose versions are three times as large.
#include <cstddef>
#include <cstdint>

extern "C" {

// Runs when a pure virtual function is called, which only a programming error can cause.
[[noreturn]] void fault_handler();
[[noreturn]] void __cxa_pure_virtual() { fault_handler(); }

// Objects with static storage are never destroyed: the image does not end.
void* __dso_handle = nullptr;
int __aeabi_atexit(void*, void (*)(void*), void*) { return 0; }
}  // extern "C"
