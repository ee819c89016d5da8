# armtrue_arm_image(NAME STARTUP SOURCES...): adds a bare-metal executable NAME.elf, linked with the startup library and
# linker script of STARTUP (stm32f405_startup, ...). NAME.bin, NAME.hex and NAME.map are written beside it.
function(armtrue_arm_image name startup)
  add_executable(${name} ${ARGN})
  set_target_properties(${name} PROPERTIES SUFFIX ".elf" RUNTIME_OUTPUT_DIRECTORY ${CMAKE_BINARY_DIR}/images)
  target_link_libraries(${name} PRIVATE armtrue_flags ${startup})
  set(stem ${CMAKE_BINARY_DIR}/images/${name})
  target_link_options(${name} PRIVATE -Wl,-Map=${stem}.map)
  add_custom_command(TARGET ${name} POST_BUILD
    COMMAND ${CMAKE_OBJCOPY} -O binary $<TARGET_FILE:${name}> ${stem}.bin
    COMMAND ${CMAKE_OBJCOPY} -O ihex $<TARGET_FILE:${name}> ${stem}.hex
    BYPRODUCTS ${stem}.bin ${stem}.hex ${stem}.map
    VERBATIM)
endfunction()
