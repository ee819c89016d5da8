set(ARMTRUE_CPU_FLAGS "-mcpu=cortex-m7 -mthumb -mfloat-abi=soft")
include(${CMAKE_CURRENT_LIST_DIR}/arm-none-eabi.cmake)
