# Settings of all bare-metal ARM builds. Include it from a toolchain file that has set ARMTRUE_CPU_FLAGS.
#
# No default libraries: only newlib's memcpy and the like and libgcc's integer helpers are linked. So use of the heap
# (malloc needs _sbrk), of exceptions or of operator delete is a link error instead of a fault on the target.
# Floating point is soft everywhere and the FPU stays off: an unintended `double` is visible as an __aeabi_d* symbol.
set(CMAKE_SYSTEM_NAME Generic)
set(CMAKE_SYSTEM_PROCESSOR arm)
set(CMAKE_TRY_COMPILE_TARGET_TYPE STATIC_LIBRARY)

set(CMAKE_C_COMPILER arm-none-eabi-gcc)
set(CMAKE_CXX_COMPILER arm-none-eabi-g++)
set(CMAKE_ASM_COMPILER arm-none-eabi-gcc)
set(CMAKE_OBJCOPY arm-none-eabi-objcopy)
set(CMAKE_FIND_ROOT_PATH_MODE_PROGRAM NEVER)
set(CMAKE_FIND_ROOT_PATH_MODE_LIBRARY ONLY)
set(CMAKE_FIND_ROOT_PATH_MODE_INCLUDE ONLY)

set(ARMTRUE_COMMON_FLAGS "${ARMTRUE_CPU_FLAGS} -ffreestanding -ffunction-sections -fdata-sections -fstack-usage -fcallgraph-info=su")
set(CMAKE_C_FLAGS_INIT "${ARMTRUE_COMMON_FLAGS}")
set(CMAKE_CXX_FLAGS_INIT "${ARMTRUE_COMMON_FLAGS} -fno-exceptions -fno-rtti -fno-threadsafe-statics -fno-use-cxa-atexit -fno-unwind-tables -fno-asynchronous-unwind-tables")
set(CMAKE_ASM_FLAGS_INIT "${ARMTRUE_CPU_FLAGS}")
set(CMAKE_EXE_LINKER_FLAGS_INIT "-nostdlib -Wl,--gc-sections -Wl,--fatal-warnings -Wl,--no-warn-rwx-segments")
set(CMAKE_C_STANDARD_LIBRARIES_INIT "-lc -lgcc")
set(CMAKE_CXX_STANDARD_LIBRARIES_INIT "-lc -lgcc")

# Measured and shipped images have the same optimisation level. Symbols are in the ELF only.
set(CMAKE_C_FLAGS_RELEASE "-O2 -g" CACHE STRING "")
set(CMAKE_CXX_FLAGS_RELEASE "-O2 -g" CACHE STRING "")
