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
}  // extern "C"
